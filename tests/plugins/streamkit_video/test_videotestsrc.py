"""Tests of videotestsrc in pipelines."""

import re
import time

import numpy as np
import pytest

from streamkit import MessageKind, Pipeline, StreamkitError
from streamkit_video import paced_source
from streamkit_video.patterns import Pattern
from tests.frames import frames_of

FORMATS = ("I420", "NV12", "BGR", "RGB", "BGRA", "RGBA", "GRAY8")


def test_its_default_is_gstreamers() -> None:
    """320x240, I420, 30 frames a second, numbered and timed."""
    frames = frames_of("videotestsrc num-buffers=3")
    caps = frames[0].caps
    assert (caps["format"], caps["width"], caps["height"], caps["framerate"]) == ("I420", 320, 240, 30)
    assert [frame.pts for frame in frames] == [0, 33_333_333, 66_666_666]
    assert [frame.duration for frame in frames] == [33_333_333, 33_333_333, 33_333_334]
    assert frames[0].data.shape == (360, 320)


@pytest.mark.parametrize("name", FORMATS)
def test_formats(name: str) -> None:
    """Every raw format has its layout."""
    (frame,) = frames_of(f"videotestsrc num-buffers=1 ! video/x-raw, format={name}, width=64, height=48")
    rows = 72 if name in ("I420", "NV12") else 48
    channels = {"BGR": (3,), "RGB": (3,), "BGRA": (4,), "RGBA": (4,)}.get(name, ())
    assert frame.data.shape == (rows, 64, *channels)
    assert not frame.data.flags.writeable


@pytest.mark.parametrize("pattern", [str(pattern) for pattern in Pattern])
def test_patterns_repeat_bit_for_bit(pattern: str) -> None:
    """Two runs agree in every frame."""
    runs = [
        frames_of(f"videotestsrc num-buffers=3 pattern={pattern} ! video/x-raw, width=64, height=48")
        for _ in range(2)
    ]
    assert all(np.array_equal(one.data, two.data) for one, two in zip(*runs, strict=True))


def test_a_still_pattern_is_painted_once() -> None:
    """Frames of an image that does not change share its memory."""
    frames = frames_of("videotestsrc num-buffers=3 ! video/x-raw, width=64, height=48")
    assert frames[0].data is frames[2].data


def test_live_frames_made_too_slowly_are_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes them in the same thread is slower than the rate."""
    monkeypatch.setattr(paced_source, "WINDOW_NS", 100_000_000)
    text = "videotestsrc is-live=true num-buffers=30 ! video/x-raw, framerate=100/1"
    said: list[str] = []
    with Pipeline.parse(f"{text} ! identity sleep-time=20000 ! fakesink") as pipeline:
        pipeline.bus.watch(lambda m: said.append(m.text) if m.kind is MessageKind.WARNING else None)
        pipeline.run(timeout_s=30)
    (warning,) = said
    assert re.match(r"makes \d\d of 100 frames/s: this machine does not keep up; put a queue", warning)


def test_the_nearest_size_allowed_is_taken() -> None:
    """Ranges give what is nearest to 320x240 at 30 a second."""
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 ! video/x-raw, width=[ 400, 800 ], framerate=[ 1/1, 15/1 ]"
    )
    caps = frame.caps
    assert (caps["width"], caps["height"], caps["framerate"]) == (400, 240, 15)


def test_an_odd_size_takes_a_format_that_has_it() -> None:
    """I420 comes first, but cannot be odd."""
    (frame,) = frames_of("videotestsrc num-buffers=1 ! video/x-raw, width=31")
    assert frame.caps["format"] == "BGR"
    with pytest.raises(
        StreamkitError, match=r"videotestsrc0: I420 needs an even width and height, got 31x240"
    ):
        frames_of("videotestsrc num-buffers=1 ! video/x-raw, format=I420, width=31")


def test_an_unknown_pattern_lists_the_known() -> None:
    """The error names the property and the choices."""
    with pytest.raises(StreamkitError, match=r"pattern cannot be 'bars': it takes smpte, snow"):
        Pipeline.parse("videotestsrc pattern=bars ! fakesink")


def test_a_live_source_keeps_real_time() -> None:
    """Four frames at 20 a second take no less than three of their intervals."""
    frames = frames_of("videotestsrc num-buffers=4 is-live=true ! video/x-raw, framerate=20/1")
    assert frames[-1].arrival_ns - frames[0].arrival_ns >= 100_000_000


def test_patterns_have_gstreamers_numbers_and_labels() -> None:
    """A pattern is written by word, number or label."""
    for text in ("ball", "18", '"Moving ball"'):
        pipeline = Pipeline.parse(f"videotestsrc name=v pattern={text} ! fakesink")
        assert pipeline["v"].pattern is Pattern.BALL


def test_colours_of_a_solid_image() -> None:
    """foreground-color is ARGB."""
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 pattern=solid-color foreground-color=0xff102030 ! video/x-raw,format=RGB"
    )
    assert frame.data[0, 0].tolist() == [0x10, 0x20, 0x30]


def test_an_image_that_scrolls_and_timestamps_with_an_offset() -> None:
    """horizontal-speed rolls to the left frame by frame, timestamp-offset is added to every time."""
    first, second = frames_of(
        "videotestsrc num-buffers=2 horizontal-speed=4 timestamp-offset=1000 "
        "! video/x-raw, format=GRAY8, width=32, height=16, framerate=10/1"
    )
    assert np.array_equal(second.data, np.roll(first.data, -4, axis=1))
    assert [first.pts, second.pts] == [1000, 100_001_000]


@pytest.mark.parametrize("source", ["videotestsrc", "dronetestsrc"])
def test_live_frames_have_a_time_of_capture(source: str) -> None:
    """As those of a camera, so that records tell their age; frames that are not live have none."""
    begin_ns = time.time_ns()
    live = frames_of(
        f"{source} num-buffers=3 is-live=true ! video/x-raw, width=64, height=48, framerate=100/1"
    )
    times = [frame.capture.utc_ns for frame in live if frame.capture is not None]
    assert len(times) == 3
    assert begin_ns <= times[0] < times[1] < times[2] <= time.time_ns()
    assert [frame.capture for frame in frames_of(f"{source} num-buffers=1")] == [None]
