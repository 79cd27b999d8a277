"""Gaps in a publisher's numbers are losses; another run is a new publisher."""

import pytest

from streamkit_zenoh.wire.numbering import KEY_LIMIT, Continuity, LossTracker, Stamp, read_attachment


def _lost(numbering: LossTracker, *numbers: int, run: int = 7, key: str = "a") -> list[int]:
    return [numbering.received(key, Stamp(run, number)).lost for number in numbers]


def test_gaps_are_counted() -> None:
    """Missing numbers between two of a run are losses; those before the first are not."""
    assert _lost(LossTracker(), 5, 6, 9, 10) == [0, 0, 2, 0]


def test_a_known_start_shows_losses() -> None:
    """The reply to a receiver holds its first number: missing numbers from there on are losses."""
    numbering = LossTracker()
    numbering.numbers_of("a", 7).starts_at(10)
    assert _lost(numbering, 12) == [2]
    numbering.numbers_of("a", 7).starts_at(100)
    assert _lost(numbering, 14) == [1]


def test_a_reply_is_the_last_message_for_a_late_receiver() -> None:
    """The last message is new once, and the next one shows no loss."""
    numbering = LossTracker()
    numbering.numbers_of("a", 7).starts_at(10)
    assert numbering.replied("a", Stamp(7, 9)) == Continuity()
    assert numbering.replied("a", Stamp(7, 9)) == Continuity(is_new=False)
    assert _lost(numbering, 10, 11) == [0, 0]
    assert numbering.replied("a", Stamp(7, 11)) == Continuity(is_new=False)


def test_a_reply_may_overtake_published_messages() -> None:
    """No message is lost: the reply is skipped if it will be published, else the others follow it."""
    with_start, without_start = LossTracker(), LossTracker()
    with_start.numbers_of("a", 7).starts_at(0)
    assert with_start.replied("a", Stamp(7, 3)) == Continuity(is_new=False)
    assert [with_start.received("a", Stamp(7, number)) for number in range(5)] == [Continuity()] * 5
    assert without_start.replied("a", Stamp(7, 3)) == Continuity()
    passed = [without_start.received("a", Stamp(7, number)) for number in range(5)]
    assert [one.is_new for one in passed] == [True, True, True, False, True]
    assert sum(one.lost for one in passed) == 0


def test_a_reply_after_a_gap_is_no_loss() -> None:
    """After an outage the last message is queried; the others are lost."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.replied("a", Stamp(7, 6)) == Continuity()
    assert _lost(numbering, 8) == [5]
    assert numbering.replied("a", Stamp(7, 12)) == Continuity()
    assert numbering.numbers_of("a", 7).settled_up_to(14) == 4


def test_keys_have_their_own_numbers() -> None:
    """Two publishers are counted separately."""
    numbering = LossTracker()
    assert _lost(numbering, 0) + _lost(numbering, 7, key="b") + _lost(numbering, 1) == [0, 0, 0]


def test_repetitions_are_not_new() -> None:
    """A message may arrive twice, or be older than the first."""
    numbering = LossTracker()
    _lost(numbering, 3, 4)
    assert numbering.received("a", Stamp(7, 4)) == Continuity(is_new=False)
    assert numbering.received("a", Stamp(7, 2)) == Continuity(is_new=False)
    assert _lost(numbering, 5) == [0]


def test_a_new_run_is_a_restart_that_starts_at_zero() -> None:
    """A receiver of the previous run was there when the next one began."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.received("a", Stamp(9, 3)) == Continuity(lost=3, is_restart=True)
    assert _lost(numbering, 4, 6, run=9) == [0, 1]


def test_a_clock_set_back_is_a_restart_too() -> None:
    """The run of a publisher whose clock was set back is lower."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.received("a", Stamp(2, 5)) == Continuity(is_restart=True)


def test_a_reply_of_an_earlier_run_is_not_new() -> None:
    """It does not follow messages of the new publisher."""
    numbering = LossTracker()
    _lost(numbering, 0)
    assert numbering.replied("a", Stamp(2, 5)) == Continuity(is_new=False)


def test_two_publishers_at_one_key_cost_no_false_loss() -> None:
    """Each has its own numbers."""
    numbering = LossTracker()
    _lost(numbering, 5)
    _lost(numbering, 100, run=9)
    assert _lost(numbering, 6) + _lost(numbering, 101, run=9) + _lost(numbering, 7) == [0, 0, 0]


def test_the_settled_number_shows_losses_at_the_end() -> None:
    """The status of a publisher shows the losses after the last message received."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.numbers_of("a", 7).settled_up_to(2) == 0
    assert numbering.numbers_of("a", 7).settled_up_to(5) == 3
    assert numbering.numbers_of("a", 7).settled_up_to(5) == 0
    assert numbering.numbers_of("unheard", 7).settled_up_to(50) == 0
    assert _lost(numbering, 5) == [0]


def test_a_stamp_is_read_from_its_attachment() -> None:
    """With and without a header."""
    stamp = Stamp(1_763_690_000_171_000_000, 120)
    assert stamp.attachment() == b"1763690000171000000 120"
    assert read_attachment(stamp.attachment()) == (stamp, b"")
    assert read_attachment(stamp.attachment(b"{}\n{}")) == (stamp, b"{}\n{}")


@pytest.mark.parametrize(
    "data", [b"", b"1", b"-1 2", b"1.5 2", b"x", b"\xff", b"9" * 20 + b" 1", "٣ ٣".encode(), b"1 2 3"]
)
def test_a_malformed_stamp_is_ignored(data: bytes) -> None:
    """Other publishers may use any attachment."""
    assert read_attachment(data) == (None, b"")
    assert LossTracker().received("a", None) == Continuity()


def test_memory_is_bounded() -> None:
    """The keys set longest ago are dropped."""
    numbering = LossTracker()
    for index in range(KEY_LIMIT + 1):
        _lost(numbering, 0, key=str(index))
    assert _lost(numbering, 100, key="0") == [0]
    assert _lost(numbering, 100, key=str(KEY_LIMIT)) == [99]
