"""Gaps in a publisher's numbers are losses; another run is a new publisher."""

import pytest

from streamkit_zenoh.wire.numbering import KEY_LIMIT, Arrival, LossTracker, Stamp, read_attachment


def _lost(numbering: LossTracker, *numbers: int, run: int = 7, key: str = "a") -> list[int]:
    return [numbering.received(key, Stamp(run, number)).lost for number in numbers]


def test_gaps_are_counted() -> None:
    """Whatever is missing between two numbers of a run was lost; what came before the first was not."""
    assert _lost(LossTracker(), 5, 6, 9, 10) == [0, 0, 2, 0]


def test_what_comes_next_may_be_told() -> None:
    """A publisher that is asked says where a receiver begins: what it misses from there on is lost."""
    numbering = LossTracker()
    numbering.starts_at("a", 7, 10)
    assert _lost(numbering, 12) == [2]
    numbering.starts_at("a", 7, 100)
    assert _lost(numbering, 14) == [1]


def test_an_answer_is_state_for_a_late_comer() -> None:
    """The last message is passed on once, and what follows it is not missed."""
    numbering = LossTracker()
    numbering.starts_at("a", 7, 10)
    assert numbering.replied("a", Stamp(7, 9)) == Arrival()
    assert numbering.replied("a", Stamp(7, 9)) == Arrival(is_new=False)
    assert _lost(numbering, 10, 11) == [0, 0]
    assert numbering.replied("a", Stamp(7, 11)) == Arrival(is_new=False)


def test_an_answer_may_overtake_what_comes_by_itself() -> None:
    """Then nothing is lost by it: left out where it is known to come, else the others pass behind it."""
    told, untold = LossTracker(), LossTracker()
    told.starts_at("a", 7, 0)
    assert told.replied("a", Stamp(7, 3)) == Arrival(is_new=False)
    assert [told.received("a", Stamp(7, number)) for number in range(5)] == [Arrival()] * 5
    assert untold.replied("a", Stamp(7, 3)) == Arrival()
    passed = [untold.received("a", Stamp(7, number)) for number in range(5)]
    assert [one.is_new for one in passed] == [True, True, True, False, True]
    assert sum(one.lost for one in passed) == 0


def test_an_answer_after_a_gap_was_not_missed() -> None:
    """The way was cut: of what came meanwhile, the last one was asked for and is here."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.replied("a", Stamp(7, 6)) == Arrival()
    assert _lost(numbering, 8) == [5]
    assert numbering.replied("a", Stamp(7, 12)) == Arrival()
    assert numbering.settled_up_to("a", 7, 14) == 4


def test_keys_are_apart() -> None:
    """Two publishers count for themselves."""
    numbering = LossTracker()
    assert _lost(numbering, 0) + _lost(numbering, 7, key="b") + _lost(numbering, 1) == [0, 0, 0]


def test_what_was_here_before_is_not_new() -> None:
    """The last record, asked for, may be one that came by itself, or an older one."""
    numbering = LossTracker()
    _lost(numbering, 3, 4)
    assert numbering.received("a", Stamp(7, 4)) == Arrival(is_new=False)
    assert numbering.received("a", Stamp(7, 2)) == Arrival(is_new=False)
    assert _lost(numbering, 5) == [0]


def test_a_new_run_is_a_restart_missed_from_its_first_number() -> None:
    """Who has heard the publisher before was there when the next one began."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.received("a", Stamp(9, 3)) == Arrival(lost=3, is_restart=True)
    assert _lost(numbering, 4, 6, run=9) == [0, 1]


def test_a_clock_set_back_is_a_restart_too() -> None:
    """A publisher whose clock went back is heard all the same."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.received("a", Stamp(2, 5)) == Arrival(is_restart=True)


def test_an_answer_of_the_past_is_not_new() -> None:
    """What an older publisher answers does not come behind what the new one has said."""
    numbering = LossTracker()
    _lost(numbering, 0)
    assert numbering.replied("a", Stamp(2, 5)) == Arrival(is_new=False)


def test_two_publishers_at_one_key_cost_no_false_loss() -> None:
    """After both are known, each is followed by its own numbers."""
    numbering = LossTracker()
    _lost(numbering, 5)
    _lost(numbering, 100, run=9)
    assert _lost(numbering, 6) + _lost(numbering, 101, run=9) + _lost(numbering, 7) == [0, 0, 0]


def test_the_end_is_caught_up_with() -> None:
    """A publisher that says how far it is shows what was lost behind the last record heard."""
    numbering = LossTracker()
    _lost(numbering, 0, 1)
    assert numbering.settled_up_to("a", 7, 2) == 0
    assert numbering.settled_up_to("a", 7, 5) == 3
    assert numbering.settled_up_to("a", 7, 5) == 0
    assert numbering.settled_up_to("unheard", 7, 50) == 0
    assert _lost(numbering, 5) == [0]


def test_a_stamp_survives_the_trip() -> None:
    """With and without a header behind it."""
    stamp = Stamp(1_763_690_000_171_000_000, 120)
    assert stamp.attachment() == b"1763690000171000000 120"
    assert read_attachment(stamp.attachment()) == (stamp, b"")
    assert read_attachment(stamp.attachment(b"{}\n{}")) == (stamp, b"{}\n{}")


@pytest.mark.parametrize(
    "data", [b"", b"1", b"-1 2", b"1.5 2", b"x", b"\xff", b"9" * 20 + b" 1", "٣ ٣".encode(), b"1 2 3"]
)
def test_what_is_no_stamp_tells_nothing(data: bytes) -> None:
    """Other publishers may attach what they like."""
    assert read_attachment(data) == (None, b"")
    assert LossTracker().received("a", None) == Arrival()


def test_memory_is_bounded() -> None:
    """Keys heard longest ago are forgotten."""
    numbering = LossTracker()
    for index in range(KEY_LIMIT + 1):
        _lost(numbering, 0, key=str(index))
    assert _lost(numbering, 100, key="0") == [0]
    assert _lost(numbering, 100, key=str(KEY_LIMIT)) == [99]
