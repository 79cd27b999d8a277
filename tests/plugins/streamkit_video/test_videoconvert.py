"""Tests of videoconvert in pipelines."""

import itertools

import numpy as np
import pytest

from streamkit import Caps, Frame, StreamkitError, raw_video_caps
from streamkit.testing import Harness
from tests.frames import frames_of

FORMATS = ("I420", "NV12", "BGR", "RGB", "BGRA", "RGBA", "GRAY8")


@pytest.mark.parametrize(("source", "target"), list(itertools.product(FORMATS, FORMATS)))
def test_every_pair_of_formats(source: str, target: str) -> None:
    """Size, rate, times and numbers stay; the format is the requested one."""
    frames = frames_of(
        f"videotestsrc num-buffers=2 ! video/x-raw, format={source}, width=16, height=12 "
        f"! videoconvert ! video/x-raw, format={target}"
    )
    caps = frames[1].caps
    assert (caps["format"], caps["width"], caps["height"], caps["framerate"]) == (target, 16, 12, 30)
    assert (frames[1].pts, frames[1].seq) == (33_333_333, 1)
    assert frames[1].data.shape[1] == 16


def test_the_same_format_passes_untouched() -> None:
    """The very frame comes out, not a copy."""
    frame = Frame(np.zeros((12, 16, 3), np.uint8), raw_video_caps("BGR", 16, 12))
    with Harness("videoconvert") as harness:
        (out,) = harness.push(frame)
    assert out.data is frame.data


def test_it_is_put_in_where_formats_disagree() -> None:
    """Negotiation inserts it between a source of grey and a sink of colour."""
    frames = frames_of("videotestsrc num-buffers=1 ! video/x-raw, format=GRAY8 ! trackoverlay status=false")
    assert frames[0].caps["format"] == "BGR"


def test_downstream_chooses_among_equals() -> None:
    """Out of what downstream takes, the sink's own format wins, then one that keeps the colours."""
    frame = Frame(np.zeros((12, 16, 3), np.uint8), raw_video_caps("BGR", 16, 12))
    for accepted, expected in (
        ("{ GRAY8, BGR }", "BGR"),
        ("{ GRAY8, NV12, RGBA }", "RGBA"),
        ("GRAY8", "GRAY8"),
    ):
        with Harness("videoconvert", downstream=f"video/x-raw, format={accepted}") as harness:
            (out,) = harness.push(frame)
        assert out.caps["format"] == expected


def test_caps_keep_every_other_field() -> None:
    """Only the format may change: sizes, rates and unknown fields cross to the other pad."""
    with Harness("videoconvert") as harness:
        across = harness.element.transform_caps(
            Caps("video/x-raw, format=NV12, width=[ 2, 8 ], framerate=5/1, views=2"), "sink"
        )
    assert across["width"] == Caps("video/x-raw, width=[ 2, 8 ]")["width"]
    assert across["views"] == 2
    assert (across & Caps("video/x-raw, format=RGBA")).is_empty is False
    assert across.fixate()["format"] == "NV12"


def test_an_odd_size_is_a_clear_error() -> None:
    """The error names the element, the format, the size and the remedy."""
    with pytest.raises(
        StreamkitError, match=r"videoconvert0: NV12 needs an even width and height, got 31x240: use"
    ):
        frames_of(
            "videotestsrc ! video/x-raw, format=BGR, width=31 ! videoconvert ! video/x-raw, format=NV12"
        )


def test_an_odd_size_avoids_what_it_cannot_have() -> None:
    """Where downstream leaves a choice, a format that has the size is taken."""
    frame = Frame(np.zeros((11, 15), np.uint8), raw_video_caps("GRAY8", 15, 11))
    with Harness("videoconvert", downstream="video/x-raw, format={ I420, NV12, RGB }") as harness:
        (out,) = harness.push(frame)
    assert out.caps["format"] == "RGB"
    assert out.data.shape == (11, 15, 3)


def test_the_size_may_change_mid_stream() -> None:
    """Each frame is converted in its own size."""
    with Harness("videoconvert", downstream="video/x-raw, format=RGB") as harness:
        for width in (16, 20):
            (out,) = harness.push(Frame(np.zeros((12, width), np.uint8), raw_video_caps("GRAY8", width, 12)))
            assert out.data.shape == (12, width, 3)
            assert out.caps["width"] == width
