import gc
from fractions import Fraction

import av
import numpy as np
import pytest
from av.filter import Graph
from numpy.typing import NDArray

from streamkit_media.decoding.frame_arrays import LUMA_FIRST, FrameReader, OddSize, oriented


def noise(width: int, height: int, pixel_format: str = "yuv420p") -> av.VideoFrame:
    """A frame of random samples in a planar 8-bit format, its lines padded as FFmpeg pads them."""
    video_frame = av.VideoFrame(width, height, pixel_format)
    generator = np.random.default_rng(width * height)
    for plane in video_frame.planes:
        plane.update(generator.integers(0, 256, plane.buffer_size, np.uint8).tobytes())
    return video_frame


def plane(video_frame: av.VideoFrame, index: int) -> NDArray[np.uint8]:
    """A copy of a plane without its padding."""
    source = video_frame.planes[index]
    rows = np.frombuffer(bytes(source), np.uint8).reshape(-1, source.line_size)
    return rows[: source.height, : source.width].copy()


@pytest.mark.parametrize("pixel_format", sorted(LUMA_FIRST))
def test_grey_is_the_luma_plane_without_copy(pixel_format: str) -> None:
    """GRAY8 of every format with a luma plane is that plane, at the decoder's own address."""
    video_frame = noise(70, 36, pixel_format)
    pixels = FrameReader("GRAY8").read(video_frame)
    assert pixels.shape == (36, 70)
    assert pixels.ctypes.data == video_frame.planes[0].buffer_ptr
    assert pixels.strides[0] == video_frame.planes[0].line_size
    assert not pixels.flags.writeable
    np.testing.assert_array_equal(pixels, plane(video_frame, 0))


def test_grey_outlives_its_frame() -> None:
    """The array keeps FFmpeg's memory alive after the frame is gone."""
    video_frame = noise(64, 48)
    wanted = plane(video_frame, 0)
    pixels = FrameReader("GRAY8").read(video_frame)
    del video_frame
    gc.collect()
    others = [noise(64, 48) for _ in range(8)]
    np.testing.assert_array_equal(pixels, wanted)
    assert len(others) == 8


def test_grey_of_odd_sizes() -> None:
    """GRAY8 works for odd sizes."""
    video_frame = noise(33, 21)
    np.testing.assert_array_equal(FrameReader("GRAY8").read(video_frame), plane(video_frame, 0))


def test_grey_of_upside_down_lines() -> None:
    """Lines stored from the bottom up (negative line size) come out from the top down."""
    video_frame = noise(64, 48)
    graph = Graph()
    source = graph.add_buffer(width=64, height=48, format="yuv420p", time_base=Fraction(1, 25))
    flip, sink = graph.add("vflip"), graph.add("buffersink")
    source.link_to(flip)
    flip.link_to(sink)
    graph.configure()
    video_frame.pts = 0
    source.push(video_frame)
    flipped = sink.pull()
    assert isinstance(flipped, av.VideoFrame)
    assert flipped.planes[0].line_size < 0
    np.testing.assert_array_equal(FrameReader("GRAY8").read(flipped), plane(video_frame, 0)[::-1])


def test_grey_of_ten_bits_is_the_upper_eight() -> None:
    """Ten-bit luma is brought to eight bits in the same range, within rounding and dither."""
    video_frame = noise(64, 48).reformat(format="yuv420p10le")
    ten = np.frombuffer(bytes(video_frame.planes[0]), "<u2").reshape(
        -1, video_frame.planes[0].line_size // 2
    )[:48, :64]
    pixels = FrameReader("GRAY8").read(video_frame)
    assert np.abs(pixels - ten / 4).max() <= 1


def test_grey_of_rgb_is_its_brightness() -> None:
    """A grey RGB frame keeps its values."""
    ramp = np.repeat(np.arange(64, dtype=np.uint8)[None, :, None] * 4, 3, axis=2).repeat(48, axis=0)
    pixels = FrameReader("GRAY8").read(av.VideoFrame.from_ndarray(ramp, "rgb24"))
    assert np.abs(pixels.astype(int) - ramp[..., 0]).max() <= 1


@pytest.mark.parametrize(("name", "ffmpeg_name"), [("I420", "yuv420p"), ("NV12", "nv12")])
def test_subsampled_formats_equal_ffmpegs(name: str, ffmpeg_name: str) -> None:
    """I420 and NV12 have the layout of OpenCV and FFmpeg."""
    video_frame = noise(64, 48)
    pixels = FrameReader(name).read(video_frame)
    assert pixels.shape == (72, 64)
    np.testing.assert_array_equal(pixels, video_frame.to_ndarray(format=ffmpeg_name))


@pytest.mark.parametrize(("name", "ffmpeg_name"), [("BGR", "bgr24"), ("RGB", "rgb24")])
@pytest.mark.parametrize("size", [(64, 48), (33, 21)])
def test_packed_formats_equal_ffmpegs(name: str, ffmpeg_name: str, size: tuple[int, int]) -> None:
    """BGR and RGB are what FFmpeg converts to, for even and odd sizes."""
    video_frame = noise(*size)
    np.testing.assert_array_equal(
        FrameReader(name).read(video_frame), video_frame.to_ndarray(format=ffmpeg_name)
    )


@pytest.mark.parametrize("name", ["I420", "NV12"])
def test_odd_sizes_have_no_subsampled_form(name: str) -> None:
    """I420 and NV12 of an odd size are refused with the size and a remedy."""
    with pytest.raises(
        OddSize, match=f"{name} needs even width and height, the frame is 33 x 48; ask for GRAY8"
    ):
        FrameReader(name).read(noise(33, 48))


def test_other_formats_are_refused() -> None:
    """An unknown format is an error that lists the known ones."""
    with pytest.raises(ValueError, match="one of GRAY8, I420, NV12, BGR, RGB, got 'RGBA'"):
        FrameReader("RGBA")


def _planes(pixels: NDArray[np.uint8], pixel_format: str) -> list[NDArray[np.uint8]]:
    """The luma, and the two planes of colour, of I420 or NV12."""
    rows, width = pixels.shape[0] * 2 // 3, pixels.shape[1]
    colours = pixels[rows:].reshape(-1)
    if pixel_format == "I420":
        return [pixels[:rows], *colours.reshape(2, rows // 2, width // 2)]
    return [pixels[:rows], *np.moveaxis(colours.reshape(rows // 2, width // 2, 2), 2, 0)]


@pytest.mark.parametrize("pixel_format", ["I420", "NV12"])
@pytest.mark.parametrize("is_flipped", [False, True])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_planes_are_turned_each(pixel_format: str, degrees: int, *, is_flipped: bool) -> None:
    """Colours stay with their pixels, as of a telephone held upright."""
    pixels = np.random.default_rng(3).integers(0, 256, (36, 16), np.uint8)
    turned = oriented(pixels, pixel_format, degrees, is_flipped=is_flipped)
    assert turned.shape == ((24, 24) if degrees % 180 else (36, 16))
    for before, after in zip(_planes(pixels, pixel_format), _planes(turned, pixel_format), strict=True):
        np.testing.assert_array_equal(after, np.rot90(before[::-1] if is_flipped else before, degrees // 90))
