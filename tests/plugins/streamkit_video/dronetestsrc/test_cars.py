"""Tests of the traffic."""

import cv2
import numpy as np
import pytest

from streamkit_video.dronetestsrc.camera import CameraPath
from streamkit_video.dronetestsrc.cars import LOOK_AHEAD, SPEEDS, TURNING_RADIUS, Traffic

SIZE = (1280, 720)


def begin(cars: int, seed: int) -> tuple[CameraPath, Traffic]:
    """A camera and the cars below it."""
    path = CameraPath((2640, 1980), SIZE, seed=seed, speed=4.0, jitter=0.5)
    return path, Traffic(cars, SIZE, path.ground_from_frame(0), path.ground_scale, seed)


def drive(path: CameraPath, traffic: Traffic, frames: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions [frames, cars, 2], headings and speeds [frames, cars]."""
    rows = []
    for index in range(frames):
        rows.append((traffic.positions.copy(), traffic.headings.copy(), traffic.speeds.copy()))
        traffic.step(path.ground_from_frame(index + LOOK_AHEAD, shaken=False))
    positions, headings, speeds = zip(*rows, strict=True)
    return np.array(positions), np.array(headings), np.array(speeds)


@pytest.mark.parametrize("seed", [0, 5])
def test_most_cars_stay_in_view(seed: int) -> None:
    """Cars turn round at the border of the view: in a typical frame at least ten of twelve are in it."""
    path, traffic = begin(12, seed)
    positions, _, _ = drive(path, traffic, 600)
    counts = []
    for index, places in enumerate(positions):
        seen = cv2.perspectiveTransform(places[None], np.linalg.inv(path.ground_from_frame(index)))[0]
        counts.append(((seen >= 0.0) & (seen <= np.array(SIZE) - 1.0)).all(axis=1).sum())
    assert np.median(counts) >= 10
    assert min(counts) >= 6


def test_cars_drive_like_cars() -> None:
    """They move the way they head, at the speeds promised, in curves no tighter than the turning radius."""
    path, traffic = begin(12, 1)
    positions, headings, speeds = drive(path, traffic, 400)
    assert speeds.min() >= SPEEDS[0]
    assert speeds.max() <= SPEEDS[1]
    steps = np.diff(positions, axis=0)
    turns = (np.diff(headings, axis=0) + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(np.hypot(steps[..., 0], steps[..., 1]), speeds[1:], rtol=1e-9)
    assert (np.abs(turns) <= speeds[1:] / TURNING_RADIUS + 1e-9).all()
    along = np.cos(np.arctan2(steps[..., 1], steps[..., 0]) - headings[1:])
    assert along.min() > 0.99


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cars_seldom_overlap(seed: int) -> None:
    """Bodies whose middles come within a body's length overlap; that is rare and short."""
    path, traffic = begin(12, seed)
    positions, _, _ = drive(path, traffic, 800)
    apart = positions[:, :, None] - positions[:, None]
    near = np.hypot(apart[..., 0], apart[..., 1]) < 22.0
    near &= ~np.eye(12, dtype=bool)
    assert near.any(axis=(1, 2)).mean() <= 0.03


def test_no_cars_at_all() -> None:
    """An empty road is a road."""
    path, traffic = begin(0, 0)
    positions, _, _ = drive(path, traffic, 3)
    assert positions.shape == (3, 0, 2)
