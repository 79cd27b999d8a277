"""Upright boxes around turned ones, and their overlap."""

import math

import numpy as np
import pytest

from streamkit.geometry.boxes import box_iou, parse_turned_box, upright_sides


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


@pytest.mark.parametrize(
    ("text", "box"),
    [("10,20,20,8", [19.5, 23.5, 20, 8, 0]), ("-1,0.5,1,4,-0.25", [-1, 2, 1, 4, -0.25])],
)
def test_a_box_in_words_is_turned_about_its_centre(text: str, box: list[float]) -> None:
    """Its left and top pixel are given; the centre of 20 pixels from 10 on is 19.5."""
    assert parse_turned_box(text).tolist() == box


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,x", "1,2,0,4", "1,2,nan,4", "1,2,3,4,5,6", "1,2,inf,4"])
def test_what_is_no_box_is_refused(text: str) -> None:
    """The error has the rule, the text and an example."""
    with pytest.raises(ValueError, match=f'above 0, got "{text}"; for example 100,80,48,32'):
        parse_turned_box(text)
