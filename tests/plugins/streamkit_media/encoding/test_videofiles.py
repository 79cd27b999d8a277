"""Pixels and times of the files that videofilesink writes."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from streamkit import Frame, MessageKind, raw_video_caps
from streamkit.testing import Harness
from streamkit_media.encoding import videofilesink
from streamkit_media.encoding.encoder import grey_as_i420, pad_to_even

RATE = Fraction(25)
SHAPES = {"GRAY8": (48, 64), "I420": (72, 64), "NV12": (72, 64), "BGR": (48, 64, 3), "RGB": (48, 64, 3)}


def frames_of(path: Path) -> list[tuple[float, NDArray[np.uint8]]]:
    """Time in s and BGR pixels of each frame in a file."""
    with av.open(str(path)) as container:
        return [
            (video_frame.time, video_frame.to_ndarray(format="bgr24"))
            for video_frame in container.decode(video=0)
        ]


def sink_of(path: Path, preset: str = "ultrafast") -> Harness:
    """The element that writes to a path."""
    return Harness("videofilesink", location=str(path), crf=18, preset=preset)


def write(path: Path, times: list[int | None], pixel_format: str = "GRAY8") -> None:
    """Writes frames of one grey at these times."""
    caps = raw_video_caps(pixel_format, 64, 48, RATE)
    with sink_of(path) as harness:
        for index, pts in enumerate(times):
            pixels = np.full(SHAPES[pixel_format], 128, np.uint8)
            pixels[:48] = 60 + 5 * index
            harness.push(Frame(pixels, caps, pts=pts))
        harness.drain()


@pytest.mark.parametrize("pixel_format", sorted(SHAPES))
def test_every_format_keeps_its_pixels(tmp_path: Path, pixel_format: str) -> None:
    """Each format is written so that it looks the same when read: H.264, yuv420p, every frame."""
    write(tmp_path / "a.mp4", [n * 40_000_000 for n in range(5)], pixel_format)
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt, stream.average_rate) == ("h264", "yuv420p", RATE)
    found = frames_of(tmp_path / "a.mp4")
    assert len(found) == 5
    for index, (_, pixels) in enumerate(found):
        grey = 60 + 5 * index
        wanted = grey if pixel_format in ("BGR", "RGB") else (grey - 16) * 255 / 219
        assert np.abs(pixels.astype(float) - wanted).mean() < 3


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        ([0, 40, 80], [0, 0.04, 0.08]),
        ([5000, 5033, 5100], [0, 0.033, 0.1]),
        ([None, None, None], [0, 0.04, 0.08]),
        ([1000, 1040, 0, 40], [0, 0.04, 0.08, 0.12]),
        ([0, 100, None, 200], [0, 0.1, 0.14, 0.2]),
        ([None, 700, 720], [0, 0.04, 0.06]),
    ],
)
def test_times_are_kept(tmp_path: Path, times: list[int | None], seconds: list[float]) -> None:
    """Times are the frames' own; without one, or where times restart, the frame rate sets them."""
    write(tmp_path / "a.mp4", [None if time is None else time * 1_000_000 for time in times])
    assert [time for time, _ in frames_of(tmp_path / "a.mp4")] == pytest.approx(seconds, abs=1e-4)


def test_a_stop_leaves_out_frames_that_take_too_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without time for the frames in the encoder a stop warns, and the file plays up to there."""
    monkeypatch.setattr(videofilesink, "FLUSH_LIMIT_S", 0.0)
    caps = raw_video_caps("GRAY8", 64, 48, RATE)
    with sink_of(tmp_path / "a.mp4", "medium") as harness:
        for index in range(30):
            harness.push(Frame(np.full((48, 64), 90 + index, np.uint8), caps, pts=index * 40_000_000))
        harness.element.stopping.set()
        harness.element.stop()
        warnings = [message.text for message in harness.messages if message.kind is MessageKind.WARNING]
    assert "the last frames are left out" in warnings[0]
    assert 1 <= len(frames_of(tmp_path / "a.mp4")) < 30


def test_without_a_frame_nothing_is_written(tmp_path: Path) -> None:
    """A sink that got no frame leaves nothing behind."""
    write(tmp_path / "a.mp4", [])
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_grow_by_a_repeated_edge(tmp_path: Path) -> None:
    """An odd frame gets one more column and row, and its own pixels stay where they were."""
    pixels = np.arange(21 * 33, dtype=np.int64).reshape(21, 33).astype(np.uint8)
    padded = pad_to_even(pixels)
    assert padded.shape == (22, 34)
    np.testing.assert_array_equal(padded[:21, :33], pixels)
    np.testing.assert_array_equal(padded[21, :33], pixels[20])
    np.testing.assert_array_equal(padded[:21, 33], pixels[:, 32])
    with sink_of(tmp_path / "a.mp4") as harness:
        harness.push(Frame(pixels, raw_video_caps("GRAY8", 33, 21, RATE), pts=0))
        harness.drain()
    assert frames_of(tmp_path / "a.mp4")[0][1].shape == (22, 34, 3)


def test_even_sizes_are_not_copied() -> None:
    """Where nothing is to be added the array itself is used."""
    pixels = np.zeros((4, 6, 3), np.uint8)
    assert pad_to_even(pixels) is pixels


def test_grey_keeps_its_range() -> None:
    """Grey becomes luma as it is, over neutral chroma."""
    luma = np.arange(24, dtype=np.uint8).reshape(4, 6)
    pixels = grey_as_i420(luma)
    np.testing.assert_array_equal(pixels[:4], luma)
    assert (pixels[4:] == 128).all()
    assert pixels.shape == (6, 6)
