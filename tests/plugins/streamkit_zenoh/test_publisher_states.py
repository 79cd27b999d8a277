"""PublisherStates: which publishers have said that they end."""

from typing import Literal

import pytest

from streamkit_zenoh.receiver import PublisherStates
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, StatusRecord


def _status(state: Literal["starting", "playing", "ended"], run: int) -> StatusRecord:
    return StatusRecord(
        schema=STATUS_SCHEMA, source="uav/1", state=state, run=run, published_ns=0, uptime_s=0.0, frames=0,
        tracks=0, streams=(), drops=(),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("statuses", "is_unended"),
    [
        ([], False),
        ([("playing", 1)], True),
        ([("playing", 1), ("ended", 1)], False),
        ([("ended", 1), ("playing", 1)], False),
        ([("ended", 1), ("starting", 2)], True),
        ([("playing", 2), ("ended", 1)], True),
    ],
)
def test_a_publisher_has_ended_if_it_says_so(
    statuses: list[tuple[Literal["starting", "playing", "ended"], int]], is_unended: bool
) -> None:
    """A reply from before the end, or of an earlier run, changes nothing; who says nothing is not missed."""
    states = PublisherStates()
    for state, run in statuses:
        states.note_status(_status(state, run))
    assert states.has_unended() is is_unended


def test_a_publisher_that_is_killed_at_its_start_has_not_ended() -> None:
    """Records of a newer run than any status show it, or its token alone; its status tells more."""
    states = PublisherStates()
    states.note_status(_status("ended", 1))
    states.note_record(2)
    assert states.has_unended()
    states.note_status(_status("ended", 2))
    assert not states.has_unended()
    states.note_appeared()
    assert states.has_unended()
    states.note_status(_status("ended", 3))
    assert not states.has_unended()
