"""Losses are exact in any order of messages, replies and status; forged numbers hide no message."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_zenoh.wire.numbering import (
    JUMP_LIMIT,
    OLDER_LIMIT,
    RANGE_LIMIT,
    Continuity,
    LossTracker,
    NumberSet,
    ReceivedNumbers,
    Stamp,
)

LARGEST = 10**19 - 1


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 5))), st.integers(-1, 50))
def test_a_set_of_numbers_is_a_set(steps: list[tuple[int, int]], asked: int) -> None:
    """It holds what a set holds, after ranges are added."""
    numbers, expected = NumberSet(), set[int]()
    for start, count in steps:
        numbers.add(start, start + count)
        expected.update(range(start, start + count))
    assert [number for number in range(60) if number in numbers] == sorted(expected)
    assert numbers.below(asked) == max((number for number in expected if number < asked), default=None)
    assert numbers.above(asked) == min((number for number in expected if number >= asked), default=None)


@st.composite
def _histories(draw: st.DrawFn) -> tuple[int, int, list[tuple[str, int]]]:
    """First number sent, next number at the end, and the events: messages, a reply, status."""
    joined = draw(st.integers(0, 40))
    count = draw(st.integers(0, 30))
    sent = sorted(draw(st.sets(st.integers(joined, joined + count)))) if count else []
    sent = [number for number in sent if number < joined + count]
    arrived = [number for number in sent if draw(st.booleans())] if draw(st.booleans()) else sent
    events = [("received", number) for number in arrived]
    known = [joined - 1] * (joined > 0) + sent
    if known and draw(st.booleans()):
        events.insert(draw(st.integers(0, len(events))), ("replied", draw(st.sampled_from(known))))
    events.insert(draw(st.integers(0, len(events))), ("starts", joined))
    events.insert(draw(st.integers(0, len(events))), ("settled", draw(st.integers(0, joined + count))))
    return joined, joined + count, [*events, ("settled", joined + count)]


@given(_histories())
def test_received_and_lost_add_up_in_every_order(
    history: tuple[int, int, list[tuple[str, int]]],
) -> None:
    """Reply and status may precede or follow any message; each message is new once."""
    joined, end, events = history
    sequence, lost, passed = ReceivedNumbers(), 0, list[int]()
    for event, number in events:
        if event == "received":
            arrival = sequence.received(number)
            lost += arrival.lost
            passed += [number] * arrival.is_new
            assert not arrival.is_jump
        elif event == "replied":
            passed += [number] * sequence.replied(number)
        elif event == "starts":
            lost += sequence.starts_at(number)
        else:
            lost += sequence.settled_up_to(number)
    assert len(set(passed)) == len(passed)
    assert lost == end - joined - len([number for number in passed if number >= joined])
    assert lost >= 0


@given(
    st.integers(0, 1000),
    st.lists(st.one_of(st.none(), st.integers(0, 1100), st.integers(0, LARGEST)), max_size=RANGE_LIMIT - 2),
)
def test_forged_numbers_hide_no_message(first: int, between: list[int | None]) -> None:
    """Whatever is forged in between, each of the publisher's messages is new once."""
    sequence, number, forged = ReceivedNumbers(), first, set[int]()
    assert sequence.received(number) == Continuity()
    for forged_number in [*between, *[None] * 20]:
        if forged_number is not None:
            sequence.received(forged_number)
            forged.add(forged_number)
            continue
        number += 1
        assert sequence.received(number).is_new is (number not in forged)


@given(st.lists(st.integers(1, 2000), max_size=40))
def test_losses_from_forged_numbers_are_corrected(ahead: list[int]) -> None:
    """Once the publisher's own numbers have passed the forged ones, nothing is lost."""
    sequence = ReceivedNumbers()
    lost = sequence.received(0).lost
    for step in ahead:
        lost += sequence.received(step).lost
    for number in range(1, 2001):
        lost += sequence.received(number).lost
    assert lost == 0


def test_a_late_status_adds_what_was_lost_before_the_first_message() -> None:
    """The status holds 3, and the first message received was 10: seven are lost."""
    sequence = ReceivedNumbers()
    assert [sequence.received(number).lost for number in (10, 11)] == [0, 0]
    assert sequence.starts_at(3) == 7
    assert sequence.starts_at(3) == 0
    assert sequence.starts_at(5) == 0
    assert sequence.received(4) == Continuity(lost=-1)


def test_a_reply_with_a_number_that_counts_as_lost_is_left_to_the_message() -> None:
    """A status overtook both messages: each is new when it is received, and nothing stays lost."""
    sequence = ReceivedNumbers()
    sequence.starts_at(1)
    assert sequence.settled_up_to(3) == 2
    assert sequence.received(1) == Continuity(lost=-1)
    assert not sequence.replied(2)
    assert sequence.received(2) == Continuity(lost=-1)


def test_the_last_status_shows_that_all_is_lost() -> None:
    """No message is needed."""
    sequence = ReceivedNumbers()
    assert sequence.starts_at(3) == 0
    assert sequence.settled_up_to(9) == 6
    assert sequence.received(9) == Continuity()


def test_a_large_step_is_a_jump_and_not_a_loss() -> None:
    """It is reported; the publisher's numbers continue, and so do those after the jump."""
    sequence = ReceivedNumbers()
    assert [sequence.received(number) for number in (5, 6)] == [Continuity(), Continuity()]
    assert sequence.received(LARGEST) == Continuity(is_jump=True)
    assert [sequence.received(number) for number in (7, 8)] == [Continuity(), Continuity()]
    assert sequence.received(9 + JUMP_LIMIT) == Continuity(lost=JUMP_LIMIT)
    assert sequence.received(LARGEST) == Continuity(is_new=False)
    assert sequence.settled_up_to(LARGEST - 5) == 0
    assert sequence.starts_at(-5) == 0


def test_a_forged_first_number_does_not_hide_the_publisher() -> None:
    """Only messages slightly older than the first are skipped as outdated."""
    sequence = ReceivedNumbers()
    sequence.received(1000)
    assert sequence.received(1000 - OLDER_LIMIT) == Continuity(is_new=False)
    assert sequence.received(5) == Continuity(is_jump=True)
    assert sequence.received(6) == Continuity()


def test_memory_is_bounded() -> None:
    """Numbers with gaps form ranges; those that grew longest ago are dropped."""
    sequence = ReceivedNumbers()
    for number in range(0, 10 * RANGE_LIMIT, 2):
        sequence.received(number)
    assert len(sequence._received) == RANGE_LIMIT
    for number in range(2 * JUMP_LIMIT, 200 * JUMP_LIMIT, 2 * JUMP_LIMIT):
        sequence.received(number)
    assert len(sequence._received) == len(sequence._settled) == RANGE_LIMIT


@pytest.mark.parametrize("forged", [Stamp(7, LARGEST), Stamp(LARGEST, 0), Stamp(LARGEST, LARGEST)])
def test_one_forged_stamp_has_no_effect(forged: Stamp) -> None:
    """Of the publisher's run or another: the publisher's messages are new, and none is lost."""
    numbering = LossTracker()
    before = [numbering.received("a", Stamp(7, number)) for number in range(3)]
    assert numbering.received("a", forged).is_new
    after = [numbering.received("a", Stamp(7, number)) for number in range(3, 9)]
    assert before + after == [Continuity()] * 9


def test_messages_of_an_earlier_run_between_those_of_a_later_one_are_marked() -> None:
    """Not those of a restart, whose earlier run is over, nor of one that goes on when the later is gone."""
    numbering = LossTracker()
    for number in range(10):
        assert not numbering.received("a", Stamp(7, number)).is_interleaved
    marked = []
    for number in range(10):
        assert not numbering.received("a", Stamp(9, number)).is_interleaved
        marked.append(numbering.received("a", Stamp(7, 10 + number)).is_interleaved)
    assert marked == [False] * 2 + [True] * 8
    marked = [numbering.received("a", Stamp(7, 20 + number)).is_interleaved for number in range(20)]
    assert marked == [True] * 15 + [False] * 5
