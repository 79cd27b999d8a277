"""Tests of drawing."""

import numpy as np
import pytest

from streamkit_video.trackoverlay.drawing import (
    LineStyle,
    box_corners,
    draw_label,
    draw_outline,
    draw_status,
    draw_trail,
    identity_colour,
)

GREEN = (0, 255, 0)


def black() -> np.ndarray:
    """A black image."""
    return np.zeros((100, 140, 3), np.uint8)


def test_corners_of_a_turned_box() -> None:
    """A box turned by a right angle stands upright; length goes along the angle."""
    corners = box_corners(50.0, 40.0, 30.0, 10.0, np.pi / 2)
    assert corners.min(axis=0) == pytest.approx([45.0, 25.0])
    assert corners.max(axis=0) == pytest.approx([55.0, 55.0])


def test_an_outline_lies_on_its_sides() -> None:
    """Pixels at the sides have the colour, the middle and the outside stay."""
    image = black()
    draw_outline(image, box_corners(60.0, 50.0, 40.0, 20.0, 0.0), GREEN, LineStyle.SOLID)
    for x, y in ((60, 40), (60, 60), (40, 50), (80, 50)):
        assert image[y, x].tolist() == [0, 255, 0]
    assert not image[50, 60].any()
    assert not image[:35].any()


def test_styles_differ() -> None:
    """Thin has fewer pixels than solid; dashed has gaps on every side, solid none."""
    drawn = {}
    for style in LineStyle:
        image = black()
        draw_outline(image, box_corners(60.0, 50.0, 60.0, 40.0, 0.0), GREEN, style)
        drawn[style] = image[:, :, 1]
    assert drawn[LineStyle.THIN].sum() < 0.8 * drawn[LineStyle.SOLID].sum()
    assert drawn[LineStyle.SOLID][30, 32:88].min() > 200
    for side in (drawn[LineStyle.DASHED][30, 32:88], drawn[LineStyle.DASHED][32:68, 90]):
        assert side.max() > 200
        assert side.min() == 0


@pytest.mark.parametrize("style", list(LineStyle))
@pytest.mark.parametrize(
    "place", [(-500.0, 20.0), (0.0, 0.0), (1e12, -1e12), (float("nan"), 3.0), (float("inf"), 0.0)]
)
def test_anything_can_be_drawn_anywhere(style: LineStyle, place: tuple[float, float]) -> None:
    """Boxes beyond the border, far away or nowhere do no harm."""
    image = black()
    corners = box_corners(*place, 20.0, 10.0, 0.3)
    draw_outline(image, corners, GREEN, style)
    draw_label(image, "17", corners, GREEN, [])
    draw_trail(image, corners, GREEN)
    assert image.any() == (place == (0.0, 0.0))


def test_a_trail_is_thick_at_its_new_end() -> None:
    """The older half is one pixel wide, the newer two or more; one point draws nothing."""
    image = black()
    draw_trail(image, np.array([[10.0, 50.0], [50.0, 50.0], [90.0, 50.0]]), GREEN)
    widths = (image[:, :, 1] > 100).sum(axis=0)
    assert widths[20] < widths[80]
    lone = black()
    draw_trail(lone, np.array([[10.0, 50.0]]), GREEN)
    assert not lone.any()


def test_a_label_stands_beside_its_box() -> None:
    """The label is to the upper right of the box, in its colour."""
    image = np.full((100, 140, 3), 128, np.uint8)
    draw_label(image, "8", box_corners(60.0, 50.0, 20.0, 10.0, 0.0), GREEN, [])
    rows, columns = np.nonzero((image[:, :, 1] > 200) & (image[:, :, 0] < 100))
    assert columns.min() >= 70
    assert rows.max() <= 46


def test_labels_cover_neither_each_other_nor_the_border() -> None:
    """Targets side by side, and one in each corner of the image."""
    labels: list[tuple[int, int, int, int]] = []
    for x, y in [(40, 50), (44, 50), (42, 54), (41, 48), (3, 3), (137, 3), (3, 97), (137, 97)]:
        draw_label(black(), "12", box_corners(x, y, 20.0, 10.0, 0.0), GREEN, labels)
    for index, (left, top, right, bottom) in enumerate(labels):
        assert min(left, top) >= 0
        assert right <= 140
        assert bottom <= 100
        for other in labels[:index]:
            assert left >= other[2] or other[0] >= right or top >= other[3] or other[1] >= bottom


def test_status_darkens_a_strip_and_writes() -> None:
    """White letters on a darker strip, the rest untouched."""
    image = np.full((200, 400, 3), 150, np.uint8)
    draw_status(image, "frame 7")
    assert image[:12].max() > 230
    assert image[1, 1].tolist() == [50, 50, 50]
    assert (image[60:] == 150).all()
    assert (image[:, 200:] == 150).all()


def test_neighbouring_ids_have_different_colours() -> None:
    """Bright, and far from the next ids' colours."""
    colours = np.array([identity_colour(identity) for identity in range(12)], float)
    assert (colours.max(axis=1) == 255).all()
    for step in (1, 2, 3):
        assert np.linalg.norm(colours[step:] - colours[:-step], axis=1).min() > 60
