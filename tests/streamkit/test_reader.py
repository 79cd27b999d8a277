"""Tests of streamkit.open."""

import gc
import logging
import re
import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import streamkit
from streamkit import DescriptionError, ElementFailure, Frame, Pipeline, StateError, raw_video_caps


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight, in a file whose name the language would have to quote."""
    path = tmp_path_factory.mktemp("reader") / "a flight!.mp4"
    with Pipeline.parse("dronetestsrc num-buffers=30 seed=1 ! videofilesink name=out") as pipeline:
        pipeline["out"].location = str(path)
        pipeline.run(timeout_s=60)
    return path


def images(count: int, shape: tuple[int, ...] = (24, 32, 3)) -> Iterator[np.ndarray]:
    """Images of one value each."""
    return (np.full(shape, number % 256, np.uint8) for number in range(count))


def test_a_file_is_read_whole(flight: Path) -> None:
    """Every frame, in OpenCV's order of colours, with its time."""
    with streamkit.open(flight) as video:
        frames = list(video)
    assert [frame.pts for frame in frames] == [number * 40_000_000 for number in range(30)]
    assert frames[0].data.shape == (720, 1280, 3)
    assert frames[0].caps["format"] == "BGR"
    assert frames[0].tracks == ()
    assert frames[0].registration is None
    assert video.pipeline.state == "null"


def test_a_reader_shows_what_it_reads(flight: Path) -> None:
    """Location, size and rate; before the first frame, and of images without a rate, what is known."""
    with streamkit.open(flight) as video:
        rate = float(next(video).caps["framerate"])
        assert repr(video) == f"<VideoReader {flight}, 1280 x 720 px BGR, {rate:.4g} frames/s>"
    with streamkit.open(images(3), framerate=25) as video:
        assert repr(video) == "<VideoReader images of the program>"
        next(video)
        assert repr(video) == "<VideoReader images of the program, 32 x 24 px BGR>"


def test_tracks_and_registration_come_with_the_frame(flight: Path) -> None:
    """A description between the file and the loop; a URL of the file works, too."""
    frames = list(streamkit.open(flight.as_uri(), "stitch ! framediff ! particletrack", format="GRAY8"))
    assert len(frames) == 30
    assert frames[-1].data.shape == (720, 1280)
    assert frames[-1].registration is not None
    assert frames[-1].tracks


def test_images_in_and_images_out() -> None:
    """Times follow from the rate; the program's own arrays stay as they are."""
    own = list(images(40))
    with streamkit.open(own, "identity", framerate=25) as video:
        frames = list(video)
    assert [int(frame.data[0, 0, 0]) for frame in frames] == list(range(40))
    assert [frame.pts for frame in frames[:2]] == [0, 40_000_000]
    assert own[0].flags.writeable


@pytest.mark.parametrize("shape", [(24, 32), (24, 32, 1), (24, 32, 4)])
def test_images_of_other_layouts(shape: tuple[int, ...]) -> None:
    """Grey and BGRA images are converted to what is asked for."""
    (frame,) = streamkit.open(images(1, shape), framerate=1)
    assert frame.data.shape == (24, 32, 3)


def test_frames_keep_their_times() -> None:
    """A program that knows when its images were taken gives frames."""
    caps = raw_video_caps("GRAY8", 4, 2)
    own = [Frame(np.zeros((2, 4), np.uint8), caps, pts=pts) for pts in (7, 11)]
    assert [frame.pts for frame in streamkit.open(own, format="GRAY8")] == [7, 11]


def test_an_endless_source_is_read_no_further_than_needed() -> None:
    """What is ahead of the loop is bounded."""
    taken = 0

    def endless() -> Iterator[np.ndarray]:
        nonlocal taken
        while True:
            taken += 1
            yield np.zeros((24, 32), np.uint8)

    with streamkit.open(endless(), framerate=25) as video:
        for _ in range(50):
            next(video)
        assert taken < 50 + 15
    with pytest.raises(ValueError, match="the reader is closed"):
        list(video)


def test_a_pipeline_that_keeps_frames_back_is_fed() -> None:
    """One frame of 30 comes out."""
    assert len(list(streamkit.open(images(90), "videorate ! video/x-raw, framerate=1/1", framerate=30))) >= 3


def test_a_pipeline_that_ends_first_ends_the_loop() -> None:
    """The rest of the images is not asked for."""
    source = images(1000)
    assert len(list(streamkit.open(source, "identity eos-after=4", framerate=30))) == 3
    assert next(source, None) is not None


@pytest.mark.parametrize("source", [0, b"flight.mp4"])
def test_what_is_no_source_is_refused_at_once(source: object) -> None:
    """A number of a camera, as OpenCV takes it, and bytes, whose items would be taken for images."""
    rule = f"open takes a file, a URL or an iterable of images, got {source!r}; give a cam"
    with pytest.raises(TypeError, match=re.escape(rule)):
        streamkit.open(source)  # type: ignore[arg-type]


def test_a_missing_file_fails_at_once() -> None:
    """The error is that of every pipeline."""
    with pytest.raises(
        ElementFailure, match=r"reader_source \(filesrc\): nothing\.mp4: a file must be there"
    ):
        streamkit.open("nothing.mp4")


def test_a_sink_at_the_end_of_the_description_is_explained(flight: Path) -> None:
    """The loop takes the frames: a sink belongs behind a tee, or into a pipeline."""
    rule = "fakesink0 has no src pad; end the description with an element that gives video"
    with pytest.raises(DescriptionError, match=rule):
        streamkit.open(flight, "identity ! fakesink")


def test_a_bad_description_points_into_itself(flight: Path) -> None:
    """Line and column are those of the caller's text."""
    with pytest.raises(DescriptionError, match='did you mean "stitch"') as caught:
        streamkit.open(flight, "identity ! stich")
    assert "identity ! stich\n    " + " " * 11 + "^^^^^" in caught.value.pointed("identity ! stich")


def test_a_failure_while_streaming_is_raised_and_ends_the_reader() -> None:
    """The loop raises what `Pipeline.run` raises, and nothing is left running."""
    video = streamkit.open(images(20), "identity error-after=3", framerate=30)
    with pytest.raises(ElementFailure, match="identity0"):
        list(video)
    assert video.pipeline.state == "null"


def test_an_error_of_the_program_is_its_own() -> None:
    """An exception of the iterable passes through the loop."""

    def broken() -> Iterator[np.ndarray]:
        yield np.zeros((24, 32), np.uint8)
        raise RuntimeError("no camera")

    with pytest.raises(RuntimeError, match=r"^no camera$"):
        list(streamkit.open(broken(), framerate=25))


@pytest.mark.parametrize(
    ("image", "rate", "message"),
    [
        (np.zeros((4, 4)), 25, r"image 0 must be uint8\[h, w\].*got float64\[4, 4\]"),
        (np.zeros((4, 4, 2), np.uint8), 25, r"image 0 must be .*got uint8\[4, 4, 2\]"),
        (np.zeros((0, 4), np.uint8), 25, "image 0 must be"),
        (np.zeros((4, 4), np.uint8), None, "framerate= must be the images' frames/s, above 0, got None"),
    ],
)
def test_what_is_no_image_is_refused(image: np.ndarray, rate: float | None, message: str) -> None:
    """The error says the rule and what came."""
    with pytest.raises(ValueError, match=message):
        list(streamkit.open([image], framerate=rate))


@pytest.mark.parametrize("rate", ["25", 0, -1.0, float("nan"), float("inf")])
def test_what_is_no_rate_is_refused_at_once(rate: Any) -> None:
    """Before anything is read."""
    rule = f"framerate= must be the images' frames/s, above 0, got {rate!r}"
    with pytest.raises(ValueError, match=re.escape(rule)):
        streamkit.open(images(1), framerate=rate)


def test_what_is_no_pixel_format_is_refused_at_once() -> None:
    """With those that are."""
    rule = "format= must be one of GRAY8, I420, NV12, BGR, RGB, BGRA, RGBA, got 'gray'"
    with pytest.raises(ValueError, match=rule):
        streamkit.open(images(1), framerate=25, format="gray")


def test_a_rate_is_for_images(flight: Path, tmp_path: Path) -> None:
    """A video has times of its own; image files take it."""
    with pytest.raises(ValueError, match=r"framerate= is for images, .*\.mp4 has times of its own; leave"):
        streamkit.open(flight, framerate=10)
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros((24, 32), np.uint8))
    with streamkit.open(tmp_path / "%d.png", framerate=10) as frames:
        assert [frame.pts for frame in frames] == [0, 100_000_000]


@pytest.mark.parametrize(
    ("framerate", "period_ns"),
    [(29.97, 33_366_667), (Fraction(24000, 1001), 41_708_333), (29.98, 33_355_570), (12.5, 80_000_000),
     (1 / 3600, 3_600_000_000_000)],
)  # fmt: skip
def test_decimal_rates_are_those_of_cameras(framerate: float, period_ns: int) -> None:
    """29.97 is 30000/1001, as in the video of the same camera; rates of one frame an hour are kept."""
    with streamkit.open(images(2), framerate=framerate) as frames:
        assert [frame.pts for frame in frames] == [0, period_ns]


@pytest.mark.parametrize("shape", [(24, 32), (24, 32, 1), (24, 32, 3), (24, 32, 4)])
def test_one_image_is_not_read_row_by_row(shape: tuple[int, ...]) -> None:
    """An array of several images is; of one, the remedy is named."""
    with pytest.raises(ValueError, match=r"several images, got one of shape .*; write \[image\] for one"):
        streamkit.open(np.zeros(shape, np.uint8), framerate=25)
    assert len(list(streamkit.open(np.zeros((2, *shape), np.uint8), framerate=25))) == 2


def test_a_second_loop_is_refused() -> None:
    """A reader that is closed or at its end has no frames; the first loop ends as it should."""
    video = streamkit.open(images(2), framerate=25)
    assert len(list(video)) == 2
    assert next(video, None) is None
    with pytest.raises(ValueError, match="the reader is closed, or its frames are read; open the"):
        list(video)
    with streamkit.open(images(2), framerate=25) as video:
        for _ in video:
            video.close()
    with pytest.raises(ValueError, match="the reader is closed"):
        list(video)


def test_a_frame_that_does_not_come_is_an_error() -> None:
    """A valve that is closed lets nothing out."""
    with pytest.raises(StateError, match=r"no frame has come within|has taken no frame within"):
        next(streamkit.open(images(1000), "valve drop=true ! identity", framerate=30, timeout_s=0.3))


def test_a_reader_that_is_forgotten_is_stopped(flight: Path) -> None:
    """No thread of a pipeline outlives its reader."""
    before = set(threading.enumerate())
    next(iter(streamkit.open(flight)))
    gc.collect()
    assert set(threading.enumerate()) <= before


def test_warnings_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    """A notebook shows them."""
    with streamkit.open(images(3), "identity", framerate=30) as video, caplog.at_level(logging.WARNING):
        video.pipeline["identity0"].post_warning("something to know")
    assert "identity0: something to know" in caplog.text


def test_a_camera_keeps_the_newest_frames(monkeypatch: pytest.MonkeyPatch, flight: Path) -> None:
    """Its reader drops what the loop does not take; that of a file waits."""
    monkeypatch.setattr(Pipeline, "play", lambda pipeline: None)
    for source, drops in (("rtsp://127.0.0.1:9/none", True), (flight, False)):
        with streamkit.open(source) as video:
            assert video.pipeline["reader_sink"].drop is drops


def test_a_camera_that_is_not_there_is_an_error() -> None:
    """The error is that of every pipeline."""
    with pytest.raises(ElementFailure, match="no connection to 127"):
        next(streamkit.open("rtsp://127.0.0.1:9/none"))


def test_image_files_by_number_are_read_from_the_lowest(tmp_path: Path) -> None:
    """Which need not be 0."""
    for number in (7, 8, 9):
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), np.full((24, 32), number, np.uint8))
    with streamkit.open(tmp_path / "%03d.png", format="GRAY8") as frames:
        assert [int(frame.data[0, 0]) for frame in frames] == [7, 8, 9]


@pytest.mark.parametrize(
    ("location", "element", "is_live"),
    [
        ("flight.mp4", "filesrc", False),
        ("C:/flight.mp4", "filesrc", False),
        ("img/%06d.jpg", "multifilesrc", False),
        ("https://host/flight.mp4", "filesrc", False),
        ("https://host/live.m3u8?x=1", "livesrc", True),
        ("http://camera/video.mjpg", "livesrc", True),
        ("udp://@239.1.2.3:5000", "livesrc", True),
        ("rtsps://drone/live", "rtspsrc", True),
        ("0", "livesrc", True),
        ("/dev/video0", "livesrc", True),
    ],
)
def test_the_source_fits_the_location(location: str, element: str, is_live: bool) -> None:
    """Live URLs are received with reconnects."""
    choice = streamkit.choose_source(location)
    assert (choice.element, choice.is_live) == (element, is_live)
