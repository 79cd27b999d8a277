"""Sizes and maps of rectified frames."""

import math

import numpy as np
import pytest

from streamkit_stitcher.flight_plan.rectification import CameraIntrinsics, Rectifier, halved_maps

SHAPE = (480, 640)
BENT = CameraIntrinsics(600.0, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
MOST = math.radians(8)


@pytest.mark.parametrize("turn", np.linspace(0, 2 * math.pi, 12, endpoint=False))
def test_every_tilt_within_the_limit_fills_the_frame(turn):
    """All maps are of the same size and point into the frame that was taken, to two pixels."""
    rectifier = Rectifier(BENT, SHAPE, 4 / 3, MOST)
    columns, rows = rectifier.maps(MOST * math.cos(turn), MOST * math.sin(turn))
    assert columns.shape == rows.shape == rectifier.size[::-1]
    assert -2 < columns.min() <= columns.max() < SHAPE[1] + 1
    assert -2 < rows.min() <= rows.max() < SHAPE[0] + 1


def test_more_room_for_tilt_leaves_less_of_the_frame():
    """The size falls with the limit, keeps its aspect and is even."""
    sizes = [Rectifier(BENT, SHAPE, 4 / 3, math.radians(most)).size for most in (0, 5, 15)]
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) == 3
    for width, height in sizes:
        assert width % 2 == height % 2 == 0
        assert width / height == pytest.approx(4 / 3, abs=0.01)


def test_too_much_tilt_is_levelled_as_far_as_the_limit():
    """The maps are those of the same direction at the limit."""
    rectifier = Rectifier(BENT, SHAPE, 4 / 3, MOST)
    assert not rectifier.can_level(2 * MOST, 0.0)
    beyond, _ = rectifier.maps(2 * MOST, 0.0)
    limit, _ = rectifier.maps(MOST, 0.0)
    assert np.array_equal(beyond, limit)


def test_a_lens_that_leaves_nothing_is_refused():
    """The error names the size and what to check."""
    with pytest.raises(ValueError, match=r"nothing can be cut out of 4 x 4 px .* focal length"):
        Rectifier(CameraIntrinsics(600.0), (4, 4), 4.0, 0.0)


def test_maps_of_half_size_lie_between_those_of_full_size():
    """Pixel x of a halved plane is between 2 x and 2 x + 1 of the whole one."""
    columns, rows = np.meshgrid(np.arange(8, dtype=np.float32) + 3, np.arange(6, dtype=np.float32) + 5)
    half_columns, half_rows = halved_maps((columns, rows))
    assert half_columns[0] == pytest.approx(np.arange(4) + 1.5)
    assert half_rows[:, 0] == pytest.approx(np.arange(3) + 2.5)
