"""The compiled comparison of textures against plain numpy."""

import cv2
import numpy as np
import pytest

from streamkit_stitcher.registration.block_sums import BLOCK, PIXELS, compare_blocks

SHAPE = (40, 64)
MOTION = np.array([[1.02, 0.01, -0.8], [-0.02, 0.98, 1.3], [2e-4, -1e-4, 1.0]])


@pytest.fixture
def images():
    """The textures of a frame and of a keyframe, and the gradients of that, float32[4, h, w]."""
    return np.random.default_rng(1).normal(size=(4, *SHAPE)).astype(np.float32)


@pytest.fixture
def origins():
    """Every second block, float64[n, 2]."""
    rows, columns = SHAPE[0] // BLOCK, SHAPE[1] // BLOCK
    return np.array([(8 * x, 8 * y) for y in range(rows) for x in range(columns) if (x + y) % 2 == 0], float)


def cut(image, origins):
    """What is compared of the blocks of an image, float32[n, 32]."""
    blocks = [image[int(y) : int(y) + BLOCK, int(x) : int(x) + BLOCK].ravel()[PIXELS] for x, y in origins]
    return np.ascontiguousarray(blocks)


def compared(images, motion, origins):
    """The result, with the power of the keyframe's blocks."""
    parts = [cut(image, origins) for image in images[1:]]
    power = (parts[0].astype(float) ** 2).mean(axis=1)
    return compare_blocks(images[0], motion, origins, *parts, power), power


def test_blocks_are_compared_where_the_motion_leads(images, origins):
    """As warped by OpenCV, with a perspective motion; blocks that reach beyond the frame do not count."""
    frame, texture, across, down = images
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(frame, MOTION, SHAPE[::-1], flags=flags, borderValue=float("nan"))
    moved = cut(warped, origins)
    filled = np.isfinite(moved).all(axis=1)
    assert 0 < np.count_nonzero(filled) < len(filled)
    difference = moved - cut(texture, origins)
    means = [
        np.where(filled, np.mean(values, axis=1), 0)
        for values in (difference**2, difference * cut(across, origins), difference * cut(down, origins))
    ]
    (visible, weights, alike, squares, *sides), power = compared(images, MOTION, origins)
    assert (visible > 0).tolist() == filled.tolist()
    assert np.array([squares, *sides]) == pytest.approx(np.array(means), abs=1e-4)
    part = squares / (power + np.where(filled, (moved**2).mean(axis=1), 0) + 0.05)
    assert weights == pytest.approx(filled / (1 + (part / 0.15) ** 2) ** 2, abs=1e-4)
    assert alike == pytest.approx(filled / (1 + (part / 0.3) ** 2) ** 2, abs=1e-4)


def test_equal_blocks_agree_up_to_the_edges_of_the_frame(images, origins):
    """The identity fills every block, the last row and column of pixels included."""
    (visible, weights, alike, squares, *_), _ = compared(images[[1, 1, 2, 3]], np.eye(3), origins)
    assert visible.tolist() == weights.tolist() == alike.tolist() == [1.0] * len(origins)
    assert squares == pytest.approx(np.zeros(len(origins)), abs=1e-12)


@pytest.mark.parametrize("motion", [np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan), np.zeros((3, 3))])
def test_a_motion_that_leads_nowhere_fills_no_block(images, origins, motion):
    """Behind the camera, not a number, or singular."""
    found, _ = compared(images, motion, origins)
    assert not found.any()
