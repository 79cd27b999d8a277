"""FrameQueue: frames and events in order, with the levels that GStreamer's queues report; its elements."""

from __future__ import annotations

from collections import deque
from typing import Any, ClassVar

from typing_extensions import override

from streamkit.element.base import Element
from streamkit.element.property import Property
from streamkit.flow.events import Event, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.statistics import QueueLevels

BYTES_LIKE = (bytes, bytearray, str)  # faster than a union made for each frame


def data_size(data: Any) -> int:
    """Bytes of an array, a packet or bytes; 0 for other objects."""
    if isinstance(data, BYTES_LIKE):
        return len(data)
    size = getattr(data, "nbytes", None)
    if size is None:
        size = getattr(data, "size", None)
    return size if isinstance(size, int) else 0


class FrameQueue:
    """A first-in first-out queue of frames and events; events have no weight.

    It has no lock: its element guards every call with `changed`.

    Attributes:
        limits: frames, bytes and time (ns) that make it full; 0 is no limit.
        items: frames and events, the oldest first.
        buffers: number of frames.
        bytes: their size.
        highest_buffers, highest_bytes, highest_time_ns: maximum levels since `reset`.
    """

    def __init__(self) -> None:
        self.limits = (0, 0, 0)
        self.items: deque[Frame | Event] = deque()
        self._sizes: deque[int] = deque()  # of the frames
        self.reset()

    def reset(self) -> None:
        """Empties the queue and resets the levels."""
        self.items.clear()
        self._sizes.clear()
        self.buffers = self.bytes = 0
        self.highest_buffers = self.highest_bytes = self.highest_time_ns = 0
        self._in_offset_ns = self._out_offset_ns = 0
        self._in_ns = self._out_ns = 0
        self._has_begun = False

    @property
    def time_ns(self) -> int:
        """Running time from the end of the last frame taken to the end of the newest one, ns."""
        return max(0, self._in_ns - self._out_ns) if self.buffers else 0

    def levels(self) -> QueueLevels:
        """The current and the maximum levels."""
        return QueueLevels(
            self.buffers,
            self.bytes,
            self.time_ns,
            self.highest_buffers,
            self.highest_bytes,
            self.highest_time_ns,
            self.limits[0],
        )

    def is_full(self) -> bool:
        """Whether any level has reached its limit."""
        max_buffers, max_bytes, max_time_ns = self.limits
        return (
            (0 < max_buffers <= self.buffers)
            or (0 < max_bytes <= self.bytes)
            or (0 < max_time_ns <= self._in_ns - self._out_ns and self.buffers > 0)
        )

    def append(self, item: Frame | Event) -> None:
        """Appends a frame or an event."""
        self.items.append(item)
        if not isinstance(item, Frame):
            if isinstance(item, SegmentEvent):
                self._in_offset_ns = item.segment.running_time_ns(0)
            return
        size = data_size(item.data)
        self._sizes.append(size)
        self.buffers += 1
        self.bytes += size
        # Comparisons: calls of `max` are a fifth of what a queue costs each frame.
        if self.buffers > self.highest_buffers:
            self.highest_buffers = self.buffers
        if self.bytes > self.highest_bytes:
            self.highest_bytes = self.bytes
        if item.pts is None:
            return
        start_ns = item.pts + self._in_offset_ns
        if not self._has_begun:
            self._has_begun = True
            self._out_ns = start_ns
        self._in_ns = start_ns + (item.duration or 0)
        if self._in_ns - self._out_ns > self.highest_time_ns:
            self.highest_time_ns = self._in_ns - self._out_ns

    def popleft(self) -> Frame | Event:
        """Takes the oldest frame or event.

        Raises:
            IndexError: the queue is empty.
        """
        item = self.items.popleft()
        if isinstance(item, Frame):
            self.buffers -= 1
            self.bytes -= self._sizes.popleft()
            if item.pts is not None:
                end_ns = item.pts + self._out_offset_ns + (item.duration or 0)
                if end_ns > self._out_ns:
                    self._out_ns = end_ns
        elif isinstance(item, SegmentEvent):
            self._out_offset_ns = item.segment.running_time_ns(0)
        return item

    def drop_oldest(self) -> bool:
        """Drops the oldest frame, never an event; False if there is no frame."""
        if not self.buffers:
            return False
        events = []
        while not isinstance(item := self.popleft(), Frame):
            events.append(item)
        self.items.extendleft(reversed(events))
        return True

    def drop_frames(self) -> int:
        """Drops all frames and keeps the events; returns the number of frames."""
        return self.replace_with([item for item in self.items if not isinstance(item, Frame)])

    def replace_with(self, events: list[Event]) -> int:
        """Replaces the contents with these events; returns the number of frames dropped."""
        dropped = self.buffers
        self._sizes.clear()
        self.items.clear()
        self.items.extend(events)
        self.buffers = self.bytes = 0
        self._has_begun = False
        self._out_ns = self._in_ns
        return dropped


class FrameHolder(Element):
    """Base class of elements that hold frames up to three limits: queue, appsrc and appsink.

    Attributes:
        limits: names of the properties that limit the frames, their bytes and their time.
        pending: the frames and events held, guarded by `changed`.
    """

    limits: ClassVar[tuple[str, str, str]] = ("max_buffers", "max_bytes", "max_time")

    current_level_buffers: int = Property(0, read=lambda e: e.pending.buffers, doc="Number of queued frames.")
    current_level_bytes: int = Property(0, read=lambda e: e.pending.bytes, unit="bytes", doc="Queued bytes.")
    current_level_time: int = Property(0, read=lambda e: e.pending.time_ns, unit="ns", doc="Queued time.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.pending = FrameQueue()
        super().__init__(name, **properties)
        self.apply_limits()

    @override
    def property_changed(self, name: str) -> None:
        super().property_changed(name)
        self.apply_limits()

    def apply_limits(self) -> None:
        """Applies the properties that are limits, and wakes the threads that wait for room."""
        buffers, size, time_ns = (getattr(self, name) for name in self.limits)
        with self.changed:
            self.pending.limits = buffers, size, time_ns
            self.changed.notify_all()
