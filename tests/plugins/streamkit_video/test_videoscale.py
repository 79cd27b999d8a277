"""Tests of videoscale in pipelines."""

import cv2
import numpy as np
import pytest

from streamkit import Frame, StreamkitError, raw_video_caps
from streamkit.testing import Harness
from streamkit_video import TrueRegistration, TrueTargets
from streamkit_video.videoscale import ScaleMethod
from tests.frames import frames_of


@pytest.mark.parametrize("method", [str(method) for method in ScaleMethod])
def test_caps_decide_the_size(method: str) -> None:
    """The size is the requested one; format, rate and times stay."""
    frames = frames_of(
        "videotestsrc num-buffers=2 ! video/x-raw, format=NV12, width=64, height=48 "
        f"! videoscale method={method} ! video/x-raw, width=20, height=30"
    )
    caps = frames[1].caps
    assert (caps["format"], caps["width"], caps["height"], caps["framerate"]) == ("NV12", 20, 30, 30)
    assert frames[1].data.shape == (45, 20)
    assert frames[1].pts == 33_333_333


@pytest.mark.parametrize(
    ("asked", "size"), [("width=32", (32, 24)), ("height=12", (16, 12)), ("width=9", (9, 7))]
)
def test_the_other_side_follows_in_proportion(asked: str, size: tuple[int, int]) -> None:
    """Where only one side is given, the image keeps its shape."""
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 ! video/x-raw, format=BGR, width=64, height=48 "
        f"! videoscale ! video/x-raw, {asked}"
    )
    assert (frame.caps["width"], frame.caps["height"]) == size
    assert frame.data.shape == (size[1], size[0], 3)


def test_planar_formats_get_an_even_side() -> None:
    """The side that follows is even for I420."""
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 ! video/x-raw, format=I420, width=64, height=48 "
        "! videoscale ! video/x-raw, width=20"
    )
    assert (frame.caps["width"], frame.caps["height"]) == (20, 16)


def test_frames_pass_untouched_where_no_size_is_asked() -> None:
    """The very array comes out."""
    frame = Frame(np.zeros((12, 16), np.uint8), raw_video_caps("GRAY8", 16, 12))
    with Harness("videoscale") as harness:
        (out,) = harness.push(frame)
    assert out.data is frame.data


def test_nothing_is_scaled_unasked() -> None:
    """Two elements that disagree on the size do not get a videoscale between them."""
    with pytest.raises(StreamkitError, match=r"could not link|not negotiated"):
        frames_of("videotestsrc num-buffers=1 ! video/x-raw, width=64 ! identity ! video/x-raw, width=32")


def test_an_odd_size_is_a_clear_error() -> None:
    """I420 cannot become odd: the error names the element, the size and the remedy."""
    with pytest.raises(
        StreamkitError, match=r"videoscale0: I420 needs an even width and height, got 31x40: use"
    ):
        frames_of(
            "videotestsrc num-buffers=1 ! video/x-raw, format=I420, width=64, height=48 "
            "! videoscale ! video/x-raw, format=I420, width=31, height=40"
        )


@pytest.mark.parametrize("source", ["I420", "{ I420, BGR }", "NV12"])
def test_an_odd_size_takes_another_format(source: str) -> None:
    """Where none is asked for, one that keeps the colours; else from a converter, which is inserted."""
    (frame,) = frames_of(
        f"videotestsrc num-buffers=1 pattern=red ! video/x-raw, format={source}, width=64, height=48 "
        "! videoscale ! video/x-raw, width=31, height=41"
    )
    assert frame.caps["format"] == "BGR"
    assert frame.data.shape == (41, 31, 3)
    assert np.abs(frame.data.astype(int) - (0, 0, 255)).max() <= 3


def test_truth_stays_true() -> None:
    """Scaled frames of dronetestsrc still match the frame before them at the scaled homography."""
    frames = frames_of(
        "dronetestsrc num-buffers=6 cars=2 noise=0 ! video/x-raw, format=GRAY8, width=480, height=360 "
        "! videoscale method=bilinear2 ! video/x-raw, width=240, height=180"
    )
    before, after = frames[-2:]
    registration = after.get(TrueRegistration)
    assert registration is not None
    assert after.get(TrueTargets) is not None
    warped = cv2.warpPerspective(
        before.data, registration.to_previous, (240, 180), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    inside = np.s_[10:-10, 10:-10]
    assert np.median(np.abs(warped[inside].astype(float) - after.data[inside])) <= 2.0
    assert np.median(np.abs(before.data[inside].astype(float) - after.data[inside])) > 4.0


def test_the_size_may_change_mid_stream() -> None:
    """A source that grows is scaled to the same size as before."""
    with Harness("videoscale", downstream="video/x-raw, width=10, height=8") as harness:
        for width, height in ((20, 16), (40, 12)):
            (out,) = harness.push(
                Frame(np.zeros((height, width), np.uint8), raw_video_caps("GRAY8", width, height))
            )
            assert out.data.shape == (8, 10)
