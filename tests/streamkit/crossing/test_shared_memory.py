"""Shared memory: integers that two processes see."""

import os

from streamkit.crossing.shared_memory import make_numbers, map_numbers


def test_integers_are_shared_and_outlive_the_descriptor() -> None:
    """They begin at zero; each side sees what the other writes."""
    ours, descriptor = make_numbers(3)
    theirs = map_numbers(descriptor, 3)
    os.close(descriptor)
    assert ours.tolist() == [0, 0, 0]
    ours[0], theirs[2] = -1, 2**40
    assert theirs.tolist() == ours.tolist() == [-1, 0, 2**40]
