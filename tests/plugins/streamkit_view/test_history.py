"""The last minutes of a feed are kept, bounded, and replayed at their own pace."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_view import history as module
from streamkit_view.history import HISTORY_S, History, replay
from streamkit_view.messages import FRAME, MOSAIC, TILE, TRACKS, VIDEO, PageMessage


def packet(number: int, *, is_keyframe: bool = False) -> PageMessage:
    """A video message of ten bytes."""
    return PageMessage(VIDEO, 0, b"%010d" % number, is_keyframe)


def filled(history: History, count: int, every_s: float) -> History:
    """A history with a keyframe every ten packets."""
    for number in range(count):
        history.note(packet(number, is_keyframe=number % 10 == 0), number * every_s)
    return history


@given(st.integers(1, 500), st.integers(1, 40), st.integers(1, 3000))
def test_it_is_bounded_in_bytes_and_time(count: int, quarters: int, max_bytes: int) -> None:
    """The newest messages stay, up to the limits."""
    every_s = quarters / 4
    history = filled(History(max_bytes), count, every_s)
    kept = min(count, max_bytes // 10, int(HISTORY_S / every_s) + 1)
    assert history.span_s((count - 1) * every_s) == max(0, kept - 1) * every_s
    found = history.get(0)
    assert (found is None) == (kept == 0)
    if found is not None:
        assert found[1].message.data == b"%010d" % found[0] == b"%010d" % (count - kept)
    assert history.get(count) is None


def test_it_begins_at_the_keyframe_before() -> None:
    """A page can show nothing earlier than a keyframe; without one it begins with the next message."""
    history = filled(History(), 35, 0.1)
    assert history.start(2.55) == 20
    assert history.start(2.0) == 20
    assert history.start(-5.0) == 0
    assert history.start(99.0) == 30
    records = History()
    for number in range(10):
        records.note(PageMessage(TRACKS, 0, str(number)), float(number))
    assert records.start(4.5) == 5
    assert records.start(99.0) == 9
    assert History().start(1.0) == 0


def test_messages_come_at_their_distances_and_new_ones_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    """One second of the past takes one second; then what comes meanwhile is replayed as late."""
    history = filled(History(), 31, 0.1)
    now = [3.0]
    taken: list[tuple[float, bytes | str]] = []

    async def sleep(seconds: float) -> None:
        now[0] += seconds
        if now[0] < 5.0:
            history.note(packet(round(now[0] * 10)), now[0])
        else:
            raise asyncio.CancelledError

    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module.asyncio, "sleep", sleep)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(replay(history, 1.95, lambda message: taken.append((now[0], message.data))))
    assert taken[0] == (3.0, packet(10).data)
    for (at_s, _), (next_s, _) in itertools.pairwise(taken[:20]):
        assert next_s - at_s == pytest.approx(0.1)
    assert taken[-1][0] > 4.5


def test_a_new_page_begins_at_the_newest_keyframe() -> None:
    """After the last image, before the last record; without a keyframe there is no video."""
    history = filled(History(), 35, 0.1)
    for number, kind in enumerate((FRAME, TRACKS, TRACKS, FRAME)):
        history.note(PageMessage(kind, 0, f"{kind} {number}"), 4.0)
    history.note(packet(35), 4.1)
    found = history.latest()
    assert [message.kind for message in found] == [FRAME, *[VIDEO] * 6, TRACKS]
    assert [message.data for message in found[1:-1]] == [packet(number).data for number in range(30, 36)]
    assert (found[0].data, found[-1].data) == ("frame 3", "tracks 2")
    without = History()
    without.note(packet(1), 0.0)
    assert without.latest() == []


def test_a_new_page_gets_all_tiles_of_the_newest_mosaic() -> None:
    """Of each the newest, behind the mosaic that they are of; those of the mosaic before are gone."""
    history = History()
    sent = [(MOSAIC, None), (TILE, (7, 7)), (MOSAIC, None), (TILE, (0, 0)), (TILE, (0, 1)), (TILE, (0, 0))]
    for number, (kind, part) in enumerate(sent):
        history.note(PageMessage(kind, 0, str(number), part=part), 0.0)
    found = history.latest()
    assert found[0].data == "2"
    assert {message.part: message.data for message in found[1:]} == {(0, 0): "5", (0, 1): "4"}
    assert history.get(0) is None  # the past has no mosaic
