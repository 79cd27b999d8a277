"""The element `rectify` on frames of a tilted camera with a bent lens."""

import math

import cv2
import numpy as np
import pytest

from streamkit import ElementFailure, Frame, Pipeline, Pose, raw_video_caps
from streamkit.testing import Harness
from streamkit_stitcher.flight_plan.rectification import CameraIntrinsics, camera_tilt, levelling

SHAPE = (480, 640)
CAMERA = CameraIntrinsics(600.0, distortion=(-0.2, 0.05, 0.0, 0.0))
LENS = {"focal_px": 600.0, "distortion": "-0.2,0.05,0,0"}


def taken(ground, pose):
    """What the camera sees of the ground, whose middle lies straight below it."""
    height, width = SHAPE
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(1, -1, 2).astype(float)
    inner = CAMERA.matrix(SHAPE)
    straight = cv2.undistortPoints(grid, inner, np.array(CAMERA.distortion), P=inner)
    tilt = camera_tilt(pose.pitch, pose.roll, pose.sensor_angles)
    level = cv2.perspectiveTransform(straight, levelling(CAMERA, SHAPE, *tilt)).reshape(*SHAPE, 2)
    level += [(ground.shape[1] - width) / 2, (ground.shape[0] - height) / 2]
    maps = level.astype(np.float32)
    return cv2.remap(ground, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)


def posed(pitch, roll, **more):
    """A pose of an aircraft whose camera looks straight down."""
    return Pose(0.0, 0.0, pitch=pitch, roll=roll, sensor_angles=(0.0, -math.pi / 2, 0.0), **more)


def grey_frame(data, pose):
    """A frame of brightness."""
    frame = Frame(data, raw_video_caps("GRAY8", SHAPE[1], SHAPE[0]))
    return frame if pose is None else frame.attach(pose)


def correlation(frame, ground):
    """The best correlation of a frame with the ground over all shifts."""
    middle = ground[400:1100, 550:1450]
    return float(cv2.matchTemplate(middle, np.ascontiguousarray(frame), cv2.TM_CCOEFF_NORMED).max())


def test_frames_come_out_as_a_level_camera_sees_them(ground):
    """Frames of any tilt within the limit lie on the ground without distortion, all in one size."""
    harness = Harness("rectify", **LENS)
    for pitch, roll in ((0.0, 0.0), (0.08, 0.0), (-0.05, 0.06)):
        pose = posed(pitch, roll)
        raw = taken(ground, pose)
        (frame,) = harness.push(grey_frame(raw, pose))
        assert frame.data.shape == (frame.caps["height"], frame.caps["width"])
        assert frame.caps["width"] / frame.caps["height"] == pytest.approx(4 / 3, abs=0.01)
        assert correlation(frame.data, ground) > 0.98
        inner = raw[60:-60, 80:-80]
        assert correlation(frame.data, ground) > correlation(inner, ground) + 0.02
    harness.close()


def test_a_frame_without_a_fresh_pose_is_only_undistorted(ground):
    """No pose, or a stale one, is no failure; it is reported once."""
    level = taken(ground, posed(0.0, 0.0))
    harness = Harness("rectify", **LENS)
    for pose in (None, posed(0.08, 0.0, is_stale=True)):
        (frame,) = harness.push(grey_frame(level, pose))
        assert correlation(frame.data, ground) > 0.98
    harness.close()


def test_colour_planes_follow_the_brightness(ground):
    """In I420 the colours are rectified as the brightness is."""
    pose = posed(0.05, -0.03)
    grey = taken(ground, pose)
    colour = cv2.cvtColor(cv2.merge([grey, 255 - grey, grey]), cv2.COLOR_BGR2YUV_I420)
    harness = Harness("rectify", **LENS)
    caps = raw_video_caps("I420", SHAPE[1], SHAPE[0])
    (frame,) = harness.push(Frame(colour, caps).attach(pose))
    width, height = frame.caps["width"], frame.caps["height"]
    assert frame.data.shape == (height * 3 // 2, width)
    back = cv2.cvtColor(np.ascontiguousarray(frame.data), cv2.COLOR_YUV2BGR_I420).astype(int)
    apart = np.abs(back[..., 0] + back[..., 1] - 255)[4:-4, 4:-4]
    assert np.median(apart) < 6
    harness.close()


def test_the_camera_must_be_known():
    """Without focal length or field of view, and with numbers that are none, it says what to write."""
    for text, rule in (
        ("rectify", "set one of them, for instance field-of-view=70"),
        (
            "rectify focal-px=600 distortion=1,2,x",
            "distortion must be 4 or 5 numbers with commas, got '1,2,x'",
        ),
    ):
        with pytest.raises(ElementFailure, match=rule):
            Pipeline.parse(f"videotestsrc num-buffers=1 ! {text} ! fakesink").run(timeout_s=20)


def test_stitch_follows_rectified_frames():
    """In a pipeline before `stitch`, which registers its frames."""
    text = "dronetestsrc num-buffers=3 ! rectify field-of-view=60 level=false ! stitch ! fakesink"
    Pipeline.parse(text).run(timeout_s=60)
