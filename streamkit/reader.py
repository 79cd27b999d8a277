"""streamkit.open: the frames of a file, camera or program, after a pipeline, in a loop."""

from __future__ import annotations

import dataclasses
import logging
import math
import os
import re
import time
import weakref
from collections.abc import Iterable, Iterator
from fractions import Fraction
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, Self
from urllib.parse import urlsplit

from streamkit.errors import DescriptionError, StateError
from streamkit.flow.clock import SECOND_NS
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.video import FORMATS as PIXEL_FORMATS
from streamkit.flow.video import exact_rate, raw_video_caps
from streamkit.graph.pipeline import Pipeline
from streamkit.masking import bounded, mask_secrets
from streamkit.output.names import FileNames

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Image = NDArray[np.uint8]

SOURCE, SINK = "reader_source", "reader_sink"
FILE_SCHEMES = ("", "file", "http", "https")
LIVE_SUFFIXES = (".m3u8", ".mjpg", ".mjpeg")  # of URLs that have no end
CAMERA = re.compile(r"\d{1,2}|/dev/video\d+")  # as OpenCV names one of this machine
FORMATS = {1: "GRAY8", 3: "BGR", 4: "BGRA"}  # by channels; OpenCV's order of colours
POLL_S = 0.005
LOGGER = logging.getLogger("streamkit")


class SourceChoice(NamedTuple):
    """What reads a location.

    Attributes:
        element: filesrc, multifilesrc, rtspsrc or livesrc.
        property: its property for the location.
        is_live: whether frames that nothing takes in time are lost.
    """

    element: str
    property: str
    is_live: bool


def choose_source(location: str) -> SourceChoice:
    """The element that reads a file, a URL or a camera of this machine."""
    parts = urlsplit(location)
    if CAMERA.fullmatch(location) and not os.path.isfile(location):
        return SourceChoice("livesrc", "uri", True)
    if parts.scheme in ("rtsp", "rtsps"):
        return SourceChoice("rtspsrc", "location", True)
    if "://" in location and (parts.scheme not in FILE_SCHEMES or parts.path.endswith(LIVE_SUFFIXES)):
        return SourceChoice("livesrc", "uri", True)
    is_pattern = not parts.scheme and FileNames(location).has_number and not os.path.isfile(location)
    return SourceChoice("multifilesrc" if is_pattern else "filesrc", "location", False)


class VideoReader:
    """Iterates over the frames that leave a pipeline; a context manager that stops it. See `streamkit.open`.

    Attributes:
        pipeline: what runs, for statistics, messages and properties of elements.
    """

    def __init__(self, pipeline: Pipeline, items: Iterator[Frame] | None, timeout_s: float) -> None:
        self.pipeline = pipeline
        self._items = items
        self._waiting: Frame | None = None
        self._timeout_s = timeout_s
        self._sink = pipeline[SINK]
        self._sink.drop = pipeline.is_live
        pipeline.bus.watch(_log_warning)
        pipeline.ends_with_program = True  # a loop may be left at any frame
        # Stops a reader that the program forgets to close, at the latest when it exits.
        self._stop = weakref.finalize(self, pipeline.stop)
        try:
            pipeline.play()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stops the pipeline, and ends the iteration."""
        self._items = self._waiting = None
        self._stop()

    def __repr__(self) -> str:
        """The location, and size and rate once the first frame has come."""
        location = mask_secrets(getattr(self.pipeline[SOURCE], "location", "") or "images of the program")
        caps = self._sink.pads["sink"].caps
        if caps is None or not caps.is_fixed:
            return f"<VideoReader {location}>"
        rate = float(caps.get("framerate") or 0)
        at_rate = f", {rate:.4g} frames/s" if rate else ""
        return f"<VideoReader {location}, {caps['width']} x {caps['height']} px {caps['format']}{at_rate}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Self:
        """Begins a loop.

        Raises:
            ValueError: the reader is closed, or at its end: the loop would do nothing.
        """
        if not self._stop.alive:
            raise ValueError("the reader is closed, or its frames are read; open the source again")
        return self

    def __next__(self) -> Frame:
        """The next frame; closes the reader at the end of the stream, and after an error.

        Raises:
            ElementFailure: the pipeline has failed.
            StateError: no frame has come within the time limit.
            ValueError: an array of the program is no image.
        """
        if not self._stop.alive:
            raise StopIteration
        try:
            frame: Frame | None = self._feed() or self._sink.pull(self._timeout_s)
        except BaseException:
            self.close()
            raise
        if frame is None:
            self.close()
            raise StopIteration
        return frame

    def _feed(self) -> Frame | None:
        """Pushes frames of the program until one comes out; None if none is left to push."""
        deadline_s = time.monotonic() + self._timeout_s
        while self._items is not None and not self._sink.eos:
            self._waiting = self._waiting or next(self._items, None)
            if self._waiting is None:
                self._items = None
                self.pipeline[SOURCE].end()
                break
            is_taken = self.pipeline[SOURCE].try_push(self._waiting)
            if is_taken:
                self._waiting, deadline_s = None, time.monotonic() + self._timeout_s
            found: Frame | None = self._sink.try_pull(0.0 if is_taken else POLL_S)
            if found is not None:
                return found
            if time.monotonic() > deadline_s:
                raise StateError(f"the pipeline has taken no frame within {self._timeout_s:g} s")
        return None


def open(
    source: str | os.PathLike[str] | Iterable[Image | Frame],
    description: str = "",
    *,
    format: str = "BGR",
    framerate: float | None = None,
    timeout_s: float = 60.0,
) -> VideoReader:
    """Plays a source through a pipeline, and iterates over the frames that come out.

    A frame has `data`, a read-only array; `pts`, ns; `tracks`, and `registration`. No frame of a file is
    lost; of a camera, the newest are kept. Few frames are held in either case.

    Args:
        source: a file, image files by number (img/%06d.jpg), a URL, or an iterable of images: uint8[h, w]
            grey, uint8[h, w, 3] BGR or uint8[h, w, 4] BGRA, which are copied, or frames with their times.
        description: elements between the source and the loop, as "stitch ! framediff ! particletrack".
        format: pixel format of the frames: BGR, RGB, GRAY8, BGRA, RGBA, I420 or NV12.
        framerate: of images, frames/s; files of video have times of their own.
        timeout_s: time limit of a frame, s.

    Raises:
        ValueError: the frame rate is no number above 0, or not for this source; the format is unknown; or the
            source is one image.
        TypeError: the source is none of these.
        DescriptionError: the description is invalid; points into it.
        ElementFailure: an element could not start, for example because there is no such file.
    """
    rate = None if framerate is None else _checked_rate(framerate)
    if format not in PIXEL_FORMATS:
        raise ValueError(f"format= must be one of {', '.join(PIXEL_FORMATS)}, got {format!r}")
    if isinstance(source, str | os.PathLike):
        items = None
        head, properties = _reading(os.fspath(source), rate)
    else:
        _check_images(source)
        items = _frames(source, rate)
        head, properties = f"appsrc name={SOURCE} max-buffers=4 emit-signals=false ! videoconvert", {}
    pipeline = _parse(head, description, format)
    for name, value in properties.items():
        pipeline[SOURCE].set_property(name, value)
    return VideoReader(pipeline, items, timeout_s)


def _reading(location: str, rate: Fraction | None) -> tuple[str, dict[str, Any]]:
    """The description of what reads a location, and the properties of its source."""
    choice = choose_source(location)
    properties: dict[str, Any] = {choice.property: location}
    if choice.element == "multifilesrc":
        numbers = [number for _, number in FileNames(location).existing()]
        properties["start-index"] = min(numbers, default=0)
        if rate is not None:
            properties["framerate"] = rate
    elif rate is not None:
        raise ValueError(
            f"framerate= is for images, {mask_secrets(location)} has times of its own; leave it out, or "
            "give videorate ! video/x-raw, framerate=N/1 as the description"
        )
    leaky = " leaky=downstream" if choice.is_live else ""
    return f"{choice.element} name={SOURCE} ! decode ! queue max-size-buffers=4{leaky}", properties


def _check_images(source: object) -> None:
    if not isinstance(source, Iterable) or isinstance(source, bytes | bytearray | memoryview):
        raise TypeError(
            f"open takes a file, a URL or an iterable of images, got {bounded(repr(source))}; "
            "give a camera by its URL, such as rtsp://camera/stream, and one of this machine as '0'"
        )
    shape = getattr(source, "shape", None)
    if shape is not None and (len(shape) < 3 or (len(shape) == 3 and shape[2] in FORMATS)):
        raise ValueError(f"open takes several images, got one of shape {list(shape)}; write [image] for one")


def _parse(head: str, description: str, format: str) -> Pipeline:
    """The pipeline with a description between source and sink; errors point into the description."""
    middle = f"\n{description}\n!" if description.strip() else ""
    tail = f"videoconvert ! video/x-raw, format={format} ! appsink name={SINK} max-buffers=4"
    try:
        return Pipeline.parse(f"{head} ! {middle} {tail}")
    except DescriptionError as error:  # its place is in the second line
        place = dataclasses.replace(error.place, line=max(1, error.place.line - 1))
        if error.code == "link" and place.line > len(description.splitlines()) and not error.hint:
            hint = "end the description with an element that gives video"
            raise DescriptionError("link", error.message, place, hint) from None
        error.place = place
        raise


def _checked_rate(framerate: object) -> Fraction:
    if not isinstance(framerate, Real) or not 0 < float(framerate) < math.inf:
        raise _wrong_rate(framerate)
    return exact_rate(float(framerate))


def _wrong_rate(framerate: object) -> ValueError:
    return ValueError(f"framerate= must be the images' frames/s, above 0, got {framerate!r}")


def _frames(items: Iterable[Any], rate: Fraction | None) -> Iterator[Frame]:
    """Frames of images, whose times follow from their number; frames pass."""
    import numpy as np

    for number, item in enumerate(items):
        if isinstance(item, Frame):
            yield item
            continue
        if rate is None:
            raise _wrong_rate(None)
        image = np.array(item, order="C")  # the program may go on to write into its own
        channels = 1 if image.ndim == 2 else image.shape[-1] if image.ndim == 3 else 0
        image = image[:, :, 0] if image.shape[2:] == (1,) else image
        if image.dtype != np.uint8 or channels not in FORMATS or not image.size:
            raise ValueError(
                f"image {number} must be uint8[h, w], uint8[h, w, 3] or uint8[h, w, 4], "
                f"got {image.dtype}{list(image.shape)}"
            )
        caps = raw_video_caps(FORMATS[channels], image.shape[1], image.shape[0])
        start, end = (round(at * SECOND_NS / rate) for at in (number, number + 1))
        yield Frame(image, caps, pts=start, duration=end - start, seq=number)


def _log_warning(message: Message) -> None:
    if message.kind is MessageKind.WARNING:
        LOGGER.warning("%s: %s", message.source or "pipeline", message.text)
