"""Histograms of the halves of boxes."""

import numpy as np

from streamkit_tracker.appearance.box_colours import box_colours

SIZE = 120, 160
LEFT, RIGHT = [10.0, 20, 40, 100], [110.0, 20, 140, 100]


def frame(tops: tuple[int, int], light: float = 1.0) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Grey levels and chroma of two people in jackets of the reds `tops` and one sort of trousers."""
    image = np.full(SIZE, 150 * light, np.uint8)
    image[40:60] = 70 * light
    red = np.full((60, 80), 128, np.uint8)
    for box, top in zip((LEFT, RIGHT), tops, strict=True):
        x0, y0, x1, y1 = (int(side) // 2 for side in box)
        red[y0 : (y0 + y1) // 2, x0:x1] = top
    return image, (np.full((60, 80), 128, np.uint8), red)


def test_alike_is_one_and_a_different_jacket_is_half():
    """The cosine of two boxes is the mean over the halves of what their histograms have in common."""
    vectors = box_colours(*frame((200, 200)), np.array([LEFT, RIGHT]))
    np.testing.assert_allclose(vectors @ vectors.T, np.ones((2, 2)), atol=1e-6)
    vectors = box_colours(*frame((200, 150)), np.array([LEFT, RIGHT]))
    np.testing.assert_allclose(vectors @ vectors.T, [[1, 0.5], [0.5, 1]], atol=1e-6)


def test_a_frame_without_colour_is_compared_by_its_levels():
    """The jackets differ in colour only."""
    image, _ = frame((200, 150))
    vectors = box_colours(image, None, np.array([LEFT, RIGHT]))
    np.testing.assert_allclose(vectors @ vectors.T, np.ones((2, 2)), atol=1e-6)


def test_another_exposure_changes_nothing():
    """Levels are relative to the frame's mean: people keep their look where a camera adapts at once."""
    (before, chroma), (after, _) = frame((200, 200)), frame((200, 200), light=0.6)
    vectors = [box_colours(image, chroma, np.array([LEFT]))[0] for image in (before, after)]
    assert vectors[0] @ vectors[1] > 0.999


def test_any_box_has_a_vector_of_length_one():
    """Boxes beyond the frame, empty, inverted, not finite; and no box at all."""
    boxes = np.array([[-500.0, -500, -400, -400], [1e30, 0, 2e30, 50], [50, 50, 50, 50], [90, 90, 10, 10]])
    broken = np.array([[np.nan] * 4, [0, 0, np.inf, np.inf]])
    vectors = box_colours(*frame((200, 150)), np.concatenate([boxes, broken]))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert len(box_colours(*frame((200, 150)), np.zeros((0, 4)))) == 0
