"""Undistorted, levelled frames and what can be cut out of them."""

import math

import cv2
import numpy as np
import pytest

from streamkit_stitcher.flight_plan.rectification import (
    CameraIntrinsics,
    inscribed_rectangle,
    levelling,
    rectification_maps,
    rectified_border,
)

SHAPE = (480, 640)
BENT = CameraIntrinsics(600.0, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))


def test_a_straight_level_camera_changes_nothing():
    """Without distortion and tilt every pixel stays."""
    columns, rows = rectification_maps(CameraIntrinsics(600.0), SHAPE, np.eye(3), (640, 480), np.zeros(2))
    assert columns[7, 9] == pytest.approx(9)
    assert rows[7, 9] == pytest.approx(7)


def test_a_levelled_frame_is_that_of_a_camera_looking_down():
    """Points of a plane seen by a tilted camera come where the level one sees them."""
    camera, roll, pitch = CameraIntrinsics(600.0), 0.08, -0.12
    ground = np.array([[-2.0, 1.0, 10.0], [1.5, -1.0, 10.0], [0.3, 2.0, 10.0]])
    turn = cv2.Rodrigues(np.array([0.0, roll, 0.0]))[0] @ cv2.Rodrigues(np.array([pitch, 0.0, 0.0]))[0]
    inner = camera.matrix(SHAPE)
    tilted = ground @ turn @ inner.T
    level = ground @ inner.T
    mapped = (
        np.column_stack([tilted[:, :2] / tilted[:, 2:], np.ones(3)]) @ levelling(camera, SHAPE, roll, pitch).T
    )
    assert mapped[:, :2] / mapped[:, 2:] == pytest.approx(level[:, :2] / level[:, 2:], abs=1e-6)


def test_a_camera_that_sees_the_horizon_is_refused():
    """Beyond 45 degrees the ground may end."""
    with pytest.raises(ValueError, match=r"up to 45 degrees, got roll 0\.0 and pitch 60\.0"):
        levelling(CameraIntrinsics(600.0), SHAPE, 0.0, math.radians(60))


def test_distortion_is_taken_out():
    """A line that the lens bends is straight again."""
    y = np.full(20, -0.3)
    ray = np.column_stack([np.linspace(-0.5, 0.5, 20), y, np.ones(20)])
    bent = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), BENT.matrix(SHAPE), np.array(BENT.distortion))[0]
    frame = np.zeros(SHAPE, np.uint8)
    cv2.polylines(frame, [np.rint(bent * 16).astype(np.int32)], False, 255, 2, cv2.LINE_AA, 4)
    maps = rectification_maps(BENT, SHAPE, np.eye(3), (640, 480), np.zeros(2))
    straight = cv2.remap(frame, *maps, cv2.INTER_LINEAR)
    centres = (straight[:, 60:580].astype(float) * np.arange(480)[:, None]).sum(0) / straight[:, 60:580].sum(
        0
    )
    assert centres == pytest.approx(239.5 - 0.3 * 600, abs=0.3)


def test_the_rectangle_lies_inside_the_border():
    """Tilt and distortion bend the border; the largest 4:3 rectangle within touches it."""
    border = rectified_border(BENT, SHAPE, levelling(BENT, SHAPE, 0.05, 0.1))
    left, top, width, height = inscribed_rectangle(border, 4 / 3)
    assert width / height == pytest.approx(4 / 3)
    outline = border.astype(np.float32)
    corners = [(left, top), (left + width, top), (left, top + height), (left + width, top + height)]
    gaps = [cv2.pointPolygonTest(outline, corner, True) for corner in corners]
    assert min(gaps) > -1.0
    assert width > 400
