"""Tests of the pixel formats."""

import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit_video.pixel_formats import FORMATS, PLANAR, by_preference, convert, image_height, supports_size

PACKED = ("BGR", "RGB", "BGRA", "RGBA")


def smooth_colour(width: int, height: int) -> np.ndarray:
    """A BGR image without sharp edges and without colours that limited range cuts."""
    rows, columns = np.mgrid[:height, :width]
    planes = [80 + 90 * columns / max(width, 1), 200 - 90 * rows / max(height, 1), 120 + 0 * rows]
    return np.rint(np.stack(planes, axis=2)).astype(np.uint8)


def image(pixel_format: str, width: int, height: int) -> np.ndarray:
    """The smooth image in a format."""
    return convert(smooth_colour(width, height), "BGR", pixel_format)


@pytest.mark.parametrize(("source", "target"), list(itertools.permutations(FORMATS, 2)))
def test_every_pair_there_and_back(source: str, target: str) -> None:
    """What both formats can hold survives: colour, but for chroma's resolution, else brightness."""
    original = image(source, 32, 24)
    there = convert(original, source, target)
    back = convert(there, target, source)
    assert image_height(there, target) == 24
    assert back.shape == original.shape
    assert back.dtype == np.uint8
    if "GRAY8" not in (source, target):
        tolerance = 0 if {source, target} <= set(PLANAR) or {source, target} <= set(PACKED) else 6
        assert np.abs(back.astype(int) - original).max() <= tolerance


def test_grey_of_planar_is_the_luma_plane_without_copy() -> None:
    """GRAY8 shares the memory of I420 and NV12, and its values are the plane's own, limited range or not."""
    for source in PLANAR:
        data = image(source, 16, 10)
        grey = convert(data, source, "GRAY8")
        assert np.shares_memory(grey, data)
        np.testing.assert_array_equal(grey, data[:10])
        np.testing.assert_array_equal(convert(convert(grey, "GRAY8", source), source, "GRAY8"), grey)


def test_the_same_format_is_the_same_array() -> None:
    """Nothing is copied where nothing changes."""
    data = image("BGRA", 8, 6)
    assert convert(data, "BGRA", "BGRA") is data


def test_channels_are_where_their_names_say() -> None:
    """Pure blue is blue in every packed format, and opaque."""
    blue = np.zeros((2, 2, 3), np.uint8)
    blue[:, :, 0] = 255
    assert convert(blue, "BGR", "RGB")[0, 0].tolist() == [0, 0, 255]
    assert convert(blue, "BGR", "RGBA")[0, 0].tolist() == [0, 0, 255, 255]
    assert convert(blue, "BGR", "BGRA")[0, 0].tolist() == [255, 0, 0, 255]


def test_nv12_interleaves_the_chroma_of_i420() -> None:
    """U and V alternate, and OpenCV reads both layouts as the same colours."""
    planar = image("I420", 16, 8)
    interleaved = convert(planar, "I420", "NV12")
    np.testing.assert_array_equal(interleaved[8:].reshape(-1)[0::2], planar[8:].reshape(-1)[:32])
    np.testing.assert_array_equal(interleaved[8:].reshape(-1)[1::2], planar[8:].reshape(-1)[32:])
    np.testing.assert_array_equal(
        cv2.cvtColor(planar, cv2.COLOR_YUV2BGR_I420), cv2.cvtColor(interleaved, cv2.COLOR_YUV2BGR_NV12)
    )


@settings(max_examples=80)
@given(
    width=st.integers(1, 40),
    height=st.integers(1, 40),
    source=st.sampled_from(("GRAY8", *PACKED)),
    target=st.sampled_from(FORMATS),
)
def test_any_size_converts_or_is_refused(width: int, height: int, source: str, target: str) -> None:
    """Every size works in every format that has it, without touching the input; others give a clear error."""
    data = convert(smooth_colour(width, height), "BGR", source)
    data.flags.writeable = False
    if supports_size(target, width, height):
        converted = convert(data, source, target)
        assert converted.shape[1] == width
        assert image_height(converted, target) == height
    else:
        with pytest.raises(
            ValueError, match=f"{target} needs an even width and height, got {width}x{height}:"
        ):
            convert(data, source, target)


@pytest.mark.parametrize("shape", [(9, 7), (7, 6), (10, 4)])
def test_planar_input_of_an_odd_size_is_refused(shape: tuple[int, int]) -> None:
    """An odd width or height shows in the layout."""
    with pytest.raises(ValueError, match="needs an even width and height"):
        convert(np.zeros(shape, np.uint8), "I420", "BGR")


def test_an_unknown_format_is_refused() -> None:
    """The error lists the formats there are."""
    with pytest.raises(ValueError, match=r"one of I420, NV12, .* got 'YUY2'"):
        convert(np.zeros((4, 4), np.uint8), "YUY2", "BGR")


@pytest.mark.parametrize("pixel_format", FORMATS)
def test_preference(pixel_format: str) -> None:
    """The format itself first, every format once, and grey never before a format that keeps the colours."""
    order = by_preference(pixel_format)
    assert order[0] == pixel_format
    assert sorted(order) == sorted(FORMATS)
    assert order.index("GRAY8") in (0, len(FORMATS) - 1)
