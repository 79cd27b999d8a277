"""Tests of videoflip in pipelines."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from streamkit import Detections, Frame, Registration, Track, Tracks, TrackState, raw_video_caps
from streamkit.testing import Harness
from streamkit_video import TrueTargets
from streamkit_video.videoflip import VideoDirection, flip_homography
from tests.frames import frames_of
from tests.plugins.streamkit_video.peer import by_gstreamer, needs_gstreamer

SOURCE = "videotestsrc num-buffers=1 pattern=smpte ! video/x-raw, format={}, width=64, height=48"
BY_NUMPY: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "identity": lambda image: image,
    "90r": lambda image: np.rot90(image, -1),
    "180": lambda image: np.rot90(image, 2),
    "90l": np.rot90,
    "horiz": np.fliplr,
    "vert": np.flipud,
    "ul-lr": lambda image: np.swapaxes(image, 0, 1),
    "ur-ll": lambda image: np.swapaxes(np.rot90(image, 2), 0, 1),
}


@pytest.mark.parametrize("direction", BY_NUMPY)
@pytest.mark.parametrize("name", ["GRAY8", "BGR"])
def test_pixels_are_those_of_numpy(name: str, direction: str) -> None:
    """Every direction, and the size that follows from it."""
    (whole,) = frames_of(SOURCE.format(name))
    (flipped,) = frames_of(f"{SOURCE.format(name)} ! videoflip video-direction={direction}")
    np.testing.assert_array_equal(flipped.data, BY_NUMPY[direction](whole.data))
    assert (flipped.caps["height"], flipped.caps["width"]) == flipped.data.shape[:2]


@needs_gstreamer
@pytest.mark.parametrize("direction", BY_NUMPY)
@pytest.mark.parametrize("name", ["I420", "BGR"])
def test_pixels_are_those_of_gstreamer(name: str, direction: str) -> None:
    """Planar formats, too."""
    line = f"videoflip video-direction={direction}"
    (whole,) = frames_of(SOURCE.format(name))
    (flipped,) = frames_of(f"{SOURCE.format(name)} ! {line}")
    np.testing.assert_array_equal(flipped.data, by_gstreamer(whole, line, flipped.data.shape))


def test_nv12_turns_like_i420() -> None:
    """The two chroma samples of a place stay together."""
    turned = [
        frames_of(f"{SOURCE.format(name)} ! videoflip method=clockwise ! video/x-raw, format=I420")[0]
        for name in ("I420", "NV12")
    ]
    np.testing.assert_array_equal(turned[0].data, turned[1].data)


@pytest.mark.parametrize("words", ["method=clockwise", "method=1", "video-direction=90r"])
def test_the_words_of_both_of_gstreamers_properties(words: str) -> None:
    """`method` is the older name of the property, with words of its own."""
    (frame,) = frames_of(f"{SOURCE.format('GRAY8')} ! videoflip {words}")
    assert (frame.caps["width"], frame.caps["height"]) == (48, 64)


@pytest.mark.parametrize("direction", list(VideoDirection))
def test_the_homography_moves_pixels_as_the_image_does(direction: VideoDirection) -> None:
    """A marked pixel is where the homography says."""
    image = np.zeros((5, 8), np.uint8)
    image[1, 6] = 255
    x, y, _ = flip_homography(direction, (8, 5)) @ (6.0, 1.0, 1.0)
    assert np.argwhere(BY_NUMPY[str(direction)](image)).tolist() == [[y, x]]


@pytest.mark.parametrize("direction", list(VideoDirection)[1:])
def test_metadata_turns_with_the_pixels(direction: VideoDirection) -> None:
    """Centres, boxes, angles, covariances and homographies."""
    track = Track(
        3,
        TrackState.CONFIRMED,
        12.0,
        8.0,
        4.0,
        2.0,
        0.3,
        (1.0, 2.0),
        np.array([[1.0, 0.5], [0.5, 2.0]]),
        0.9,
        7,
    )
    one = np.array([0.5])
    detections = Detections(np.array([[12.0, 8.0]]), np.array([[10.0, 7.0, 14.0, 9.0]]), one, one)
    frame = Frame(np.zeros((24, 32), np.uint8), raw_video_caps("GRAY8", 32, 24), pts=0)
    frame = frame.attach(Registration(np.eye(3), np.eye(3)), Tracks((track,)), detections)
    mapping = flip_homography(direction, (32, 24))
    with Harness("videoflip", video_direction=direction) as harness:
        (out,) = harness.push(frame)
    (turned,), found = out.tracks, out.get(Detections)
    assert found is not None
    assert out.registration is not None
    x, y, _ = mapping @ (12.0, 8.0, 1.0)
    assert (turned.x, turned.y, turned.length, turned.width) == pytest.approx((x, y, 4.0, 2.0))
    np.testing.assert_allclose(
        (np.cos(turned.angle), np.sin(turned.angle)), mapping[:2, :2] @ (np.cos(0.3), np.sin(0.3)), atol=1e-12
    )
    np.testing.assert_allclose(turned.covariance, mapping[:2, :2] @ track.covariance @ mapping[:2, :2].T)
    np.testing.assert_allclose(found.centroids, [[x, y]])
    assert (found.boxes[0, :2] < found.boxes[0, 2:]).all()
    np.testing.assert_allclose(found.boxes[0].reshape(2, 2).mean(axis=0), (x, y))
    np.testing.assert_allclose(out.registration.to_reference @ mapping, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(out.registration.to_previous, np.eye(3))


def test_cars_of_the_truth_are_where_they_are_seen() -> None:
    """The patch around a car is the turned patch."""
    text = "dronetestsrc num-buffers=1 seed=1 ! {} video/x-raw, format=GRAY8"
    (whole,), (turned,) = frames_of(text.format("")), frames_of(text.format("videoflip method=1 !"))
    before, after = whole.get(TrueTargets), turned.get(TrueTargets)
    assert before is not None
    assert after is not None
    patches = [
        cv2.getRectSubPix(frame.data, (21, 21), tuple(targets.centres[0]))
        for frame, targets in ((whole, before), (turned, after))
    ]
    difference = np.rot90(patches[0], -1).astype(int) - patches[1]
    assert np.abs(difference).max() <= 1
