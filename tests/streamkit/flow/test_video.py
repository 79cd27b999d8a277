"""Raw video: caps, luma and array layout."""

from fractions import Fraction

import numpy as np
import pytest

from streamkit import LUMA_CAPS, Caps, Frame, luma, raw_video_caps
from streamkit.flow.video import check_layout


def test_caps_of_raw_video_are_fixed() -> None:
    """Format, size and, where it is known, the frame rate."""
    caps = raw_video_caps("NV12", 640, 360, Fraction(30000, 1001))
    assert caps == Caps("video/x-raw, format=NV12, width=640, height=360, framerate=30000/1001")
    assert caps.is_fixed
    assert raw_video_caps("BGR", 2, 2).get("framerate") is None


@pytest.mark.parametrize(("pixel_format", "rows"), [("GRAY8", 4), ("I420", 6), ("NV12", 6)])
def test_luma_is_a_view(pixel_format: str, rows: int) -> None:
    """The brightness of grey and planar video is its first plane, without copy."""
    data = np.arange(rows * 8, dtype=np.uint8).reshape(rows, 8)
    frame = Frame(data, raw_video_caps(pixel_format, 8, 4))
    plane = luma(frame)
    assert plane.shape == (4, 8)
    assert np.shares_memory(plane, data)
    assert frame.caps <= Caps(LUMA_CAPS)


def test_luma_of_a_colour_format_is_an_error() -> None:
    """It names the remedy."""
    frame = Frame(np.zeros((4, 8, 3), np.uint8), raw_video_caps("BGR", 8, 4))
    with pytest.raises(
        TypeError, match="luma needs a frame of format GRAY8, I420, NV12, got 'BGR': put videoconvert"
    ):
        luma(frame)


def layout_error(frame: Frame) -> str | None:
    """The text of the error, or None."""
    try:
        check_layout(frame)
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("pixel_format", "shape"),
    [("GRAY8", (4, 8)), ("I420", (6, 8)), ("NV12", (6, 8)), ("RGB", (4, 8, 3)), ("BGRA", (4, 8, 4))],
)
def test_arrays_must_match_the_caps(pixel_format: str, shape: tuple[int, ...]) -> None:
    """Unknown formats and data that is not an array are not checked."""
    caps = raw_video_caps(pixel_format, 8, 4)
    right = Frame(np.zeros(shape, np.uint8), caps)
    assert layout_error(right) is None
    assert layout_error(right.replace(data=b"")) is None
    assert layout_error(right.replace(caps=Caps("video/x-raw, format=GRAY16_LE, width=8, height=4"))) is None
    assert layout_error(right.replace(caps=Caps("video/x-raw, width=8, height=4"))) is None
    rows = f"{pixel_format} of 8 x 4 px is uint8{list(shape)}, got "
    give = ": give the frame the caps of what it holds"
    short = right.data[:3]
    assert layout_error(right.replace(data=short)) == f"{rows}uint8{list(short.shape)}{give}"
    make = ": make it uint8, as np.clip(data, 0, 255).astype(np.uint8) does"
    assert layout_error(right.replace(data=right.data.astype(float))) == f"{rows}float64{list(shape)}{make}"
