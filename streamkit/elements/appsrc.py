"""appsrc: frames from the application."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from typing_extensions import override

from streamkit.element.frame_queue import FrameHolder
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import INT, INT64, UINT64, Choice
from streamkit.element.source import Source
from streamkit.elements.fakesrc import StreamFormat
from streamkit.elements.frame_report import Callbacks, wait_for_change
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import Event
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.handoff.bounded_queue import POLL_S


class LeakyType(Choice):
    """The frame that a full queue drops."""

    NONE = "none", 0, "GST_APP_LEAKY_TYPE_NONE"
    UPSTREAM = "upstream", 1, "GST_APP_LEAKY_TYPE_UPSTREAM"
    DOWNSTREAM = "downstream", 2, "GST_APP_LEAKY_TYPE_DOWNSTREAM"


class AppSrc(FrameHolder, Source):
    """Streams what the application passes to `push`; `end` closes the stream.

    Everything pushed before the pipeline plays is kept. Later `push` waits while the queue is full, unless
    `block` is off (the queue then exceeds its limits, as in GStreamer) or `leaky-type` drops a frame.

    Attributes:
        on_need_data: called with the element and `max-bytes` if the queue is empty or below `min-percent`.
        on_enough_data: called with the element when a limit is reached.

    Example:
        appsrc name=in ! fakesink
    """

    src = "ANY"

    caps: Caps | None = Property(ANY, live=True, doc="Caps of bare data.")
    max_buffers: int = Property(16, min=0, max=UINT64, live=True, doc="Frame limit; 0 is none.")
    max_bytes: int = Property(0, min=0, max=UINT64, live=True, unit="bytes", doc="Size limit; 0 is none.")
    max_time: int = Property(0, min=0, max=UINT64, live=True, unit="ns", doc="Time limit; 0 is none.")
    block: bool = Property(True, live=True, doc="`push` waits while the queue is full; else the queue grows.")
    leaky_type: LeakyType = Property(LeakyType.NONE, live=True, doc="Which frame a full queue drops instead.")
    num_buffers: int = Property(-1, min=-1, max=INT, doc="Frames before EOS; -1 is endless.")
    is_live: bool = Property(False, doc="Frames arrive at their own pace; none are sent while paused.")
    do_timestamp: bool = Property(False, doc="Timestamp frames that have no timestamp with the running time.")
    min_latency: int = Property(-1, min=-1, max=INT64, unit="ns", doc="Minimum age of live frames; -1 is 0.")
    max_latency: int = Property(-1, min=-1, max=INT64, unit="ns", doc="Maximum age; -1 is no limit.")
    emit_signals: bool = Property(True, live=True, doc="Call `on_need_data` and `on_enough_data`.")
    min_percent: int = Property(
        0, min=0, max=100, live=True, unit="%", doc="Ask for data below this share of max-bytes."
    )
    duration: int = Property(UINT64, min=0, max=UINT64, unit="ns", doc="Stream length; the maximum: unknown.")
    format: StreamFormat = Property(StreamFormat.BYTES, doc="Accepted, without effect: times are ns.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_need_data, self.on_enough_data = Callbacks(), Callbacks()
        self._closed = False
        self._had_gap = False
        super().__init__(name, **properties)

    def property_changed(self, name: str) -> None:
        """Applies new limits, and wakes waiting threads; None for caps is ANY."""
        if name == "caps" and self.caps is None:
            self.caps = ANY
        super().property_changed(name)

    @override
    def duration_ns(self) -> int | None:
        return None if self.duration == UINT64 else self.duration

    @override
    def latency(self) -> tuple[int, int | None]:
        return max(0, self.min_latency), None if self.max_latency < 0 else self.max_latency

    def stop(self) -> None:
        """Drops queued frames; those pushed before the next start are kept."""
        with self.changed:
            self.pending.reset()
            self._closed = self._had_gap = False

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The property `caps` if fixed, else those of the first frame."""
        return self.caps if self.caps is not None and self.caps.is_fixed else None

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.negotiate(ANY) or ANY  # a converter can be inserted for them

    # Called by the application.

    def push(self, item: Any, timeout_s: float = 5.0, **fields: Any) -> None:
        """Queues a frame, an event, or bare data with fields such as `pts`.

        Raises:
            StateError: the queue stayed full for `timeout_s`, the pipeline stopped, or `end` was called.
            ElementFailure: the pipeline has failed.
            TypeError: an array without caps, or None.
        """
        if item is None:
            raise TypeError(
                f"{self.name}: push takes a frame or data, got None: cv2's read gives it where there is no "
                "image; call end() after the last one"
            )
        if not isinstance(item, Event | Frame):
            if self.caps in (None, ANY) and hasattr(item, "__array_interface__"):
                raise TypeError(
                    f"{self.name}: an array needs caps, which say its pixel format: set caps=, or push "
                    "Frame(array, raw_video_caps(format, width, height))"
                )
            item = Frame(item, self.caps or ANY, **fields)
        whole = getattr(getattr(item, "data", None), "base", None)
        if isinstance(item, Frame) and getattr(getattr(whole, "flags", None), "writeable", False):
            item = item.replace(data=item.data.copy())  # the program may write into the whole again
        with self.changed:
            self._check_open()
            is_full = isinstance(item, Frame) and self.is_playing and self.pending.is_full()
        if is_full and self.emit_signals:
            self.on_enough_data.emit(self)
        with self.changed:
            if is_full and not self._make_room(timeout_s):
                return
            if self._had_gap and isinstance(item, Frame):
                self._had_gap = False
                item = item.replace(flags=item.flags | FrameFlags.DISCONTINUITY)
            self.pending.append(item)
            self.changed.notify_all()

    def push_list(self, items: Iterable[Any], timeout_s: float = 5.0) -> None:
        """Pushes several items in order; see `push`."""
        for item in items:
            self.push(item, timeout_s)

    def try_push(self, item: Any, **fields: Any) -> bool:
        """Pushes a frame unless the queue is full; whether it did.

        Raises:
            StateError: `end` was called.
        """
        with self.changed:
            self._check_open()
            if self.pending.is_full():
                return False
        self.push(item, **fields)
        return True

    def end(self) -> None:
        """Ends the stream after the frames pushed so far."""
        with self.changed:
            self._closed = True
            self.changed.notify_all()

    def _check_open(self) -> None:
        if self._closed:
            raise StateError(f"{self.name}: no frame can follow end(); stop the pipeline to start again")

    def _make_room(self, timeout_s: float) -> bool:
        """Drops, waits or neither, by the properties; False if the new frame is dropped."""
        if self.leaky_type is LeakyType.UPSTREAM:
            self._had_gap = True
            self.count_drop("appsrc full, newest dropped")
            return False
        drops = self.leaky_type is LeakyType.DOWNSTREAM
        while drops and self.pending.is_full() and self.pending.drop_oldest():
            self._had_gap = True
            self.count_drop("appsrc full, oldest dropped")

        def has_room() -> bool:
            waits = self.leaky_type is LeakyType.NONE and self.block
            return not (waits and self.pending.is_full())

        if has_room():
            return True
        is_made = wait_for_change(self, has_room, lambda: False, timeout_s)
        if self.stopping.is_set():  # which makes room, too
            raise StateError(f"{self.name}: the pipeline was stopped while a frame waited for room")
        if not is_made:
            raise StateError(
                f"{self.name}: no room for a frame within {timeout_s} s: nothing downstream takes it"
            )
        return True

    # Called in the streaming thread.

    @override
    def frames(self) -> Iterator[Frame | Event]:
        taken = 0
        while taken != self.num_buffers and (item := self._take()) is not None:
            taken += isinstance(item, Frame)
            yield item

    def _take(self) -> Frame | Event | None:
        """Waits for the oldest item; None if none follows."""
        is_low = not self.pending.items or 100 * self.pending.bytes < self.min_percent * self.max_bytes
        if self.emit_signals and is_low:
            self.on_need_data.emit(self, self.max_bytes)
        with self.changed:
            while not self.pending.items:
                if self._closed or self.over.is_set():
                    return None
                self.changed.wait(POLL_S)
            item = self.pending.popleft()
            self.changed.notify_all()
        if isinstance(item, Frame) and item.pts is None and self.do_timestamp:
            return item.replace(pts=self.timing.running_time_ns())
        return item
