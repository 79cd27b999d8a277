"""Metadata of scaled frames."""

import cv2
import numpy as np
import pytest

from streamkit import (
    Detections,
    Features,
    Frame,
    Registration,
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
    scale_metadata,
)
from streamkit.geometry.scaling import scaling_homography

SCALING = scaling_homography((640, 480), (320, 160))
SAME = np.eye(3)


def bare() -> Frame:
    """A frame without metadata."""
    return Frame(np.zeros((4, 4), np.uint8), raw_video_caps("GRAY8", 4, 4))


def mapped(homography: np.ndarray, x: float, y: float) -> np.ndarray:
    """A point through a homography."""
    return cv2.perspectiveTransform(np.array([[[x, y]]]), homography)[0, 0]


def test_registration_maps_scaled_pixels_to_scaled_pixels() -> None:
    """Scaling then registering is registering then scaling; the reference plane stays where it was."""
    homography = np.array([[0.98, 0.1, 5.0], [-0.1, 1.01, -3.0], [1e-5, -2e-5, 1.0]])
    frame = bare().attach(Registration(homography, homography @ homography, rmse=0.4, inliers=9))
    scaled = scale_metadata(frame, SCALING, SCALING).get(Registration)
    assert scaled is not None
    point = (200.0, 100.0)
    np.testing.assert_allclose(
        mapped(scaled.to_previous, *mapped(SCALING, *point)), mapped(SCALING, *mapped(homography, *point))
    )
    np.testing.assert_allclose(
        mapped(scaled.to_reference, *mapped(SCALING, *point)), mapped(homography @ homography, *point)
    )
    assert scaled.to_previous[2, 2] == 1.0
    assert scaled.inliers == 9
    assert scaled.rmse == pytest.approx(0.4 * np.sqrt(0.5 / 3.0))


def test_the_previous_frame_may_have_another_scaling() -> None:
    """After a change of size `to_previous` maps to the pixels of the previous frame."""
    frame = bare().attach(Registration(np.eye(3), np.eye(3)))
    scaled = scale_metadata(frame, SCALING, SAME).get(Registration)
    assert scaled is not None
    np.testing.assert_allclose(mapped(scaled.to_previous, *mapped(SCALING, 77.0, 11.0)), (77.0, 11.0))


def test_non_finite_homographies_are_kept() -> None:
    """They are not replaced."""
    frame = bare().attach(Registration(np.full((3, 3), np.nan), np.eye(3)))
    scaled = scale_metadata(frame, SCALING, SCALING).get(Registration)
    assert scaled is not None
    assert np.isnan(scaled.to_previous).all()
    assert np.isfinite(scaled.to_reference).all()


def test_detections_are_scaled() -> None:
    """Boxes, centroids and areas; scores and labels are kept."""
    item = Detections(
        np.array([[100.0, 60.0]]),
        np.array([[80.0, 50.0, 120.0, 70.0]]),
        np.array([600.0]),
        np.array([0.7]),
        ("car",),
    )
    scaled = scale_metadata(bare().attach(item), SCALING, SCALING).get(Detections)
    assert scaled is not None
    np.testing.assert_allclose(scaled.boxes[0, :2], mapped(SCALING, 80.0, 50.0))
    np.testing.assert_allclose(scaled.boxes[0, 2:], mapped(SCALING, 120.0, 70.0))
    np.testing.assert_allclose(scaled.centroids[0], mapped(SCALING, 100.0, 60.0))
    np.testing.assert_allclose(scaled.areas, [100.0])
    assert (scaled.scores[0], scaled.labels) == (0.7, ("car",))


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, -2.5])
def test_tracks_are_scaled(angle: float) -> None:
    """Ends of rotated boxes follow the pixels; velocities on the plane are kept."""
    track = Track(
        3, TrackState.CONFIRMED, 90.0, 40.0, 30.0, 12.0, angle, (5.0, 6.0), np.diag([4.0, 9.0]), 0.9, 10
    )
    scaled = scale_metadata(bare().attach(Tracks((track,))), SCALING, SCALING).get(Tracks)
    assert scaled is not None
    (new,) = scaled.tracks
    end = mapped(SCALING, 90.0 + 15.0 * np.cos(angle), 40.0 + 15.0 * np.sin(angle))
    np.testing.assert_allclose(
        (new.x + new.length / 2 * np.cos(new.angle), new.y + new.length / 2 * np.sin(new.angle)), end
    )
    np.testing.assert_allclose(new.covariance, np.diag([1.0, 1.0]))
    assert (new.id, new.velocity, new.score, new.age_ns) == (3, (5.0, 6.0), 0.9, 10)


def test_other_metadata_passes() -> None:
    """What has no pixels is the same object."""
    features = Features(np.zeros((1, 2), np.float32))
    frame = bare().attach(features)
    assert scale_metadata(frame, SCALING, SCALING).get(Features) is features
