"""Marks of the foreground."""

import numpy as np

from streamkit_differencer.marks import mark


def test_foreground_is_marked_with_what_it_is():
    """What changed lately is 255, what is quiet 128; outside the region nothing is written."""
    mask, quiet = np.array([[0, 0, 255, 255, 255]], np.uint8), np.array([[0, 255, 0, 255, 255]], np.uint8)
    marks = np.full((1, 5), 77, np.uint8)
    mark(mask, quiet, marks, (0, 1, 0, 4))
    assert marks.tolist() == [[0, 0, 255, 128, 77]]
