"""Tests of the camera's path."""

import cv2
import numpy as np
import pytest

from streamkit_video.dronetestsrc.camera import CameraPath

IMAGE = (2640, 1980)


def outline(width: int, height: int) -> np.ndarray:
    """The outer border of a frame's border pixels."""
    right, bottom = width - 0.5, height - 0.5
    return np.array([[[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]]])


@pytest.mark.parametrize("size", [(1280, 720), (320, 240), (1080, 1920), (8192, 64)])
def test_the_view_never_leaves_the_image(size: tuple[int, int]) -> None:
    """For any frame number, size and jitter, all four corners are within the ground image."""
    path = CameraPath(IMAGE, size, seed=3, speed=4.0, jitter=2.0)
    for index in range(0, 200_000, 613):
        corners = cv2.perspectiveTransform(outline(*size), path.ground_from_frame(index))[0]
        assert corners.min() >= 0.0
        assert (corners <= np.array(IMAGE) - 1.0).all()


def test_a_frame_pixel_is_about_an_image_pixel() -> None:
    """At 720p the shipped image is shown about 1:1; a frame too large for it is shown enlarged."""
    assert CameraPath(IMAGE, (1280, 720), seed=0, speed=4.0, jitter=0.5).ground_scale == 1.0
    assert CameraPath(IMAGE, (3840, 2160), seed=0, speed=4.0, jitter=0.5).ground_scale < 0.5


def test_the_camera_moves_at_its_speed() -> None:
    """The view's middle moves at most `speed` per frame along either axis, and often half of it."""
    path = CameraPath(IMAGE, (1280, 720), seed=1, speed=4.0, jitter=0.0)
    middles = np.array(
        [
            cv2.perspectiveTransform(np.array([[[639.5, 359.5]]]), path.ground_from_frame(k))[0, 0]
            for k in range(900)
        ]
    )
    steps = np.abs(np.diff(middles, axis=0))
    assert steps.max() <= 4.0
    assert np.median(np.hypot(*steps.T)) >= 2.0


def test_jitter_is_the_only_unsteadiness() -> None:
    """Without jitter the path is smooth; with it frames shake by about its standard deviation."""

    def roughness(jitter: float) -> float:
        path = CameraPath(IMAGE, (640, 480), seed=1, speed=4.0, jitter=jitter)
        places = np.array([path.ground_from_frame(k)[:2, 2] for k in range(400)])
        return float(np.diff(places, n=2, axis=0).std())

    assert roughness(0.0) < 0.1
    # The second difference of white noise has sqrt(6) times its deviation.
    assert roughness(1.0) == pytest.approx(np.sqrt(6.0), rel=0.25)


def test_a_frame_number_decides_the_view() -> None:
    """The view of a frame does not depend on the frames rendered before it."""
    one, other = (CameraPath(IMAGE, (640, 480), seed=7, speed=4.0, jitter=0.5) for _ in range(2))
    one.ground_from_frame(3)
    np.testing.assert_array_equal(one.ground_from_frame(41), other.ground_from_frame(41))
    assert not np.allclose(one.ground_from_frame(41), one.ground_from_frame(41, shaken=False))
