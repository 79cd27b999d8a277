"""Gaps in a publisher's numbers are losses; a number that goes back is a new publisher."""

import pytest

from streamkit_zenoh.numbering import KEY_LIMIT, Numbering


def test_gaps_are_counted() -> None:
    """Whatever is missing between two numbers of a key was lost; what came before the first was not."""
    numbering = Numbering()
    assert [numbering.lost_before("a", number) for number in (b"5", b"6", b"9", b"10")] == [0, 0, 2, 0]
    assert numbering.restarts == 0


def test_keys_are_apart() -> None:
    """Two publishers count for themselves."""
    numbering = Numbering()
    assert [
        numbering.lost_before(key, number) for key, number in (("a", b"0"), ("b", b"7"), ("a", b"1"))
    ] == [0, 0, 0]


def test_going_back_is_a_restart() -> None:
    """A publisher that begins anew has lost nothing."""
    numbering = Numbering()
    for number in (b"0", b"1", b"0", b"1"):
        assert numbering.lost_before("a", number) == 0
    assert numbering.restarts == 1


@pytest.mark.parametrize("text", [b"", b"-1", b"1.5", b"x", b"\xff", b"9" * 19, "٣".encode()])
def test_what_is_no_number_tells_nothing(text: bytes) -> None:
    """Other publishers may attach what they like."""
    numbering = Numbering()
    numbering.lost_before("a", b"1")
    assert numbering.lost_before("a", text) == 0
    assert numbering.lost_before("a", b"2") == 0
    assert numbering.restarts == 0


def test_memory_is_bounded() -> None:
    """Keys heard longest ago are forgotten."""
    numbering = Numbering()
    for index in range(KEY_LIMIT + 1):
        numbering.lost_before(str(index), b"0")
    assert numbering.lost_before("0", b"100") == 0
    assert numbering.lost_before(str(KEY_LIMIT), b"100") == 99
