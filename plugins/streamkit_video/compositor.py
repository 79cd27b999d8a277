"""compositor: several videos side by side."""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import (
    Caps,
    Combine,
    Direction,
    EndOfStream,
    EosEvent,
    Event,
    Flushing,
    Frame,
    Pad,
    PadTemplate,
    Presence,
    StreamError,
)

ByteArray = NDArray[np.uint8]
BGR = "video/x-raw, format=BGR"
HELD_LIMIT = 8  # frames of an input that wait for those of the others
POLL_S = 0.1


class Compositor(Combine):
    """Puts videos side by side, in the order in which they are linked, aligned at the top.

    There is one frame for each of the first input, with its times and metadata. Every other input shows its
    newest frame up to that time; one that has not begun is black. An input waits for the others, so put a
    `queue` before each that comes from a `tee`. The stream ends with the first input.

    Example:
        compositor name=c ! fakesink  videotestsrc num-buffers=5 ! c.  videotestsrc num-buffers=5 ! c.
    """

    src = BGR
    templates = (PadTemplate("sink_%u", Direction.SINK, Caps(BGR), Presence.REQUEST),)

    def __init__(self, name: str = "", **properties: Any) -> None:
        super().__init__(name, **properties)
        self._changed = threading.Condition(self.combine_lock)

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._held: defaultdict[Pad, deque[tuple[int, Frame]]] = defaultdict(deque)  # with running times, ns
        self._newest_ns: dict[Pad, int] = {}  # running time of the newest frame that has come
        self._shown: dict[Pad, ByteArray] = {}
        self._caps: Caps | None = None

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return Caps(BGR)

    @override
    def combine(self, pad_name: str, frame: Frame) -> Iterator[Frame]:
        pad = self.pads[pad_name]
        if frame.pts is None:
            raise StreamError(f"{pad.path}: frames are composed by time, this one has no pts; see its source")
        held = self._held[pad]
        with self.waiting():
            while len(held) >= HELD_LIMIT and not self._is_over():
                if self.stopping.is_set() or self.is_flushing:
                    raise Flushing(self.name)
                self._changed.wait(POLL_S)
        if self._is_over():
            raise EndOfStream(self.name)
        self._newest_ns[pad] = pad.segment.running_time_ns(frame.pts)
        held.append((self._newest_ns[pad], frame))
        yield from self._composed()

    @override
    def receive_event(self, pad: Pad, event: Event) -> None:
        if isinstance(event, EosEvent):
            with self.combine_lock:
                pad.is_eos = True
                for frame in self._composed():
                    self.push_output(frame, self._main)
                self._changed.notify_all()
        super().receive_event(pad, event)

    @override
    def send_segment(self, pad: Pad) -> None:
        super().send_segment(self._main)

    @override
    def flush(self, *, begins: bool) -> None:
        super().flush(begins=begins)
        if begins:  # an input that has the lock may be held downstream, where the flush has not begun yet
            return
        with self.combine_lock:
            for held in self._held.values():  # an input may wait for room in it
                self.count_drop("flushed", len(held))
                held.clear()
            self._newest_ns.clear()
            self._changed.notify_all()

    @property
    def _main(self) -> Pad:
        """The input whose frames are those of the output."""
        return next(self.sink_pads())

    def _is_over(self) -> bool:
        return self._main.is_eos and not self._held[self._main]

    def _composed(self) -> Iterator[Frame]:
        """The frames for which every input has what it shows; called with the lock."""
        main, *others = self.sink_pads()
        waiting = self._held[main]
        while waiting:
            time_ns, frame = waiting[0]
            for pad in others:
                self._show(pad, time_ns)
            self._changed.notify_all()
            if not all(self._has_reached(pad, time_ns) for pad in others):
                return
            waiting.popleft()
            images = [frame.data, *(image for pad in others for image in self._images(pad))]
            data = side_by_side(images)
            height, width = data.shape[:2]
            caps = frame.caps.with_fields(width=width, height=height)
            if self._caps != caps:
                self._caps = caps
            yield frame.replace(data=data, caps=self._caps)

    def _has_reached(self, pad: Pad, time_ns: int) -> bool:
        return pad.is_eos or (pad in self._newest_ns and self._newest_ns[pad] >= time_ns)

    def _show(self, pad: Pad, time_ns: int) -> None:
        """Makes an input show its newest frame up to a running time, ns; those before it are skipped."""
        held = self._held[pad]
        while held and held[0][0] <= time_ns:
            self._shown[pad] = held.popleft()[1].data

    def _images(self, pad: Pad) -> list[ByteArray]:
        """What an input shows; nothing for one that ended before its first frame."""
        if pad in self._shown:
            return [self._shown[pad]]
        held = self._held[pad]
        return [np.zeros(held[0][1].data.shape, np.uint8)] if held else []


def side_by_side(images: list[ByteArray]) -> ByteArray:
    """Images uint8[h, w, 3] in a row, aligned at the top; black below those that are lower."""
    height, width = max(image.shape[0] for image in images), sum(image.shape[1] for image in images)
    row = np.zeros((height, width, 3), np.uint8)
    left = 0
    for image in images:
        row[: image.shape[0], left : left + image.shape[1]] = image
        left += image.shape[1]
    return row
