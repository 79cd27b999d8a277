"""Ground truth of a scaled frame."""

import cv2
import numpy as np

from streamkit.geometry.scaling import scaling_homography
from streamkit_video import TrueRegistration, TrueTargets

SCALING = scaling_homography((640, 480), (320, 160))
SAME = np.eye(3)


def mapped(homography: np.ndarray, x: float, y: float) -> np.ndarray:
    """A point through a homography."""
    return cv2.perspectiveTransform(np.array([[[x, y]]]), homography)[0, 0]


def test_the_true_frame_before_may_have_been_scaled_otherwise() -> None:
    """After a change of size, `to_previous` leads to the pixels that the previous frame had."""
    scaled = TrueRegistration(np.eye(3), np.eye(3)).scaled(SCALING, SAME)
    np.testing.assert_allclose(mapped(scaled.to_previous, *mapped(SCALING, 77.0, 11.0)), (77.0, 11.0))


def test_true_targets_are_scaled_like_tracks() -> None:
    """Truth of dronetestsrc stays true."""
    item = TrueTargets(
        np.array([4]),
        np.array([[10.0, 20.0]]),
        np.array([8.0]),
        np.array([6.0]),
        np.array([0.0]),
        np.array([[2.0, 3.0]]),
    )
    scaled = item.scaled(SCALING)
    np.testing.assert_allclose(scaled.centres[0], mapped(SCALING, 10.0, 20.0))
    np.testing.assert_allclose((scaled.lengths[0], scaled.widths[0]), (4.0, 2.0))
    np.testing.assert_allclose(scaled.velocities[0], (1.0, 1.0))
