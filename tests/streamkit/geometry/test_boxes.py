"""Upright boxes around turned ones, and their overlap."""

import math

import numpy as np
import pytest

from streamkit.geometry.boxes import box_iou, upright_sides


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, (40, 20)), (math.pi / 2, (20, 40)), (-math.pi / 4, (60 * math.sqrt(0.5), 60 * math.sqrt(0.5)))],
)
def test_the_upright_box_holds_the_turned_one(angle: float, expected: tuple[float, float]) -> None:
    """Along the axes it is the box itself, with its sides exchanged in between."""
    assert upright_sides(40.0, 20.0, angle) == pytest.approx(expected)


def test_overlap_of_boxes() -> None:
    """Same, half and nothing; a box without area overlaps nothing."""
    first = np.array([[0.0, 0, 10, 10], [3, 3, 3, 3]])
    second = np.array([[0.0, 0, 10, 10], [5, 0, 15, 10], [30, 0, 40, 10]])
    np.testing.assert_allclose(box_iou(first, second), [[1, 1 / 3, 0], [0, 0, 0]])
    assert box_iou(first, np.zeros((0, 4))).shape == (2, 0)
