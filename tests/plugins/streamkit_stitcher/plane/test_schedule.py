"""The centre constraint's changes of plane."""

import pytest

from streamkit_stitcher.plane.schedule import left_checkpoints, reference_at, right_checkpoints


def changes(length, most):
    """(count, reference) of every change up to `most` keyframes."""
    return [(count, due) for count in range(1, most + 1) if (due := reference_at(count, length)) is not None]


def test_the_published_lists():
    """n/8, n/4, n/2 on the left; (n/2 + n)/2 and on, on the right."""
    assert left_checkpoints(32) == (2, 4, 8, 16)
    assert right_checkpoints(32) == (24, 28, 30, 31)


def test_a_strip_of_known_length_ends_on_its_middle():
    """Up to the middle the plane is that of the middle so far; from there on it stays."""
    found = changes(16, 16)
    assert found[:2] == [(2, 1), (4, 2)]
    assert {reference for count, reference in found if count > 8} == {8}
    assert (9, 8) in found
    assert (12, 8) in found


def test_an_unknown_length_doubles():
    """The plane moves to n/2 at n = 4, 8, 16, ..."""
    assert changes(0, 70) == [(4, 2), (8, 4), (16, 8), (32, 16), (64, 32)]


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_strip_too_short_to_halve_is_taken_as_unknown(length):
    """It still has a middle as it grows."""
    assert changes(length, 8) == [(4, 2), (8, 4)]
