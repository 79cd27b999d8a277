"""Levels: how much a line of frames and events holds, counted without a lock."""

from __future__ import annotations

import sys
from collections import deque
from typing import Any

from streamkit.flow.events import Event
from streamkit.flow.frame import Frame

EMPTY = b""  # one object: a frame whose data is it weighs nothing, and costs nothing to weigh


def data_size(data: Any) -> int:
    """Bytes of an array, a packet or bytes; 0 where that cannot be told."""
    size = getattr(data, "nbytes", None)
    if size is None:
        size = getattr(data, "size", None)
    if isinstance(size, int):
        return size
    return len(data) if isinstance(data, bytes | bytearray | str) else 0


class Levels:
    """Bytes and running time of what a line holds; frames are the length of the line less its events.

    Each attribute has one writing thread, so none needs a lock: `in_` is upstream's, `out_` downstream's.

    Attributes:
        in_bytes, out_bytes: bytes taken in and handed on.
        in_events, out_events: events taken in and handed on.
        in_ns: running time at the end of the newest frame taken in.
        out_ns: running time at the end of the newest frame handed on; at first the start of the first frame.
        in_offset_ns, out_offset_ns: running time of a timestamp of 0, in the segment in force at that end.
        has_begun: whether a timestamp has been seen, so that `out_ns` means something.
        most: length of the line from which a frame is to be looked at before it goes in.
        alert: length from which anything is to be done: `most`, or the most held so far.
        limit_bytes, limit_ns: when the line is full.
        highest_buffers, highest_bytes, highest_ns: the most held.
    """

    __slots__ = (
        "_items", "alert", "has_begun", "highest_buffers", "highest_bytes", "highest_ns", "in_bytes",
        "in_events", "in_ns", "in_offset_ns", "limit_bytes", "limit_ns", "most", "out_bytes", "out_events",
        "out_ns", "out_offset_ns",
    )  # fmt: skip

    def __init__(self, items: deque[Frame | Event]) -> None:
        self._items = items
        self.alert = 0
        self.most = self.limit_bytes = self.limit_ns = sys.maxsize
        self.reset()

    def reset(self) -> None:
        """Begins anew, when nothing streams."""
        self.in_bytes = self.in_events = self.in_ns = self.in_offset_ns = 0
        self.out_bytes = self.out_events = self.out_ns = self.out_offset_ns = 0
        self.highest_buffers = self.highest_bytes = self.highest_ns = self.alert = 0
        self.has_begun = False

    @property
    def buffers(self) -> int:
        """Frames held now."""
        return max(0, len(self._items) - self.in_events + self.out_events)

    @property
    def bytes(self) -> int:
        """Bytes held now."""
        return self.in_bytes - self.out_bytes

    @property
    def time_ns(self) -> int:
        """Running time from the end of the newest frame handed on to the end of the newest held, ns."""
        return max(0, self.in_ns - self.out_ns) if self.buffers else 0

    def rise(self) -> None:
        """A frame is about to go in: the most held may grow."""
        self.highest_buffers = max(self.highest_buffers, self.buffers + 1)
        self.alert = min(self.most, self.highest_buffers)

    def weigh_in(self, frame: Frame) -> None:
        """Counts bytes and time of a frame that goes in."""
        self.in_bytes += data_size(frame.data)
        self.highest_bytes = max(self.highest_bytes, self.in_bytes - self.out_bytes)
        if frame.pts is None:
            return
        start_ns = frame.pts + self.in_offset_ns
        if not self.has_begun:
            self.out_ns = start_ns
            self.has_begun = True
        self.in_ns = start_ns + (frame.duration or 0)
        self.highest_ns = max(self.highest_ns, self.in_ns - self.out_ns)

    def weigh_out(self, frame: Frame) -> None:
        """Counts bytes and time of a frame that is handed on."""
        self.out_bytes += data_size(frame.data)
        self._pass_time(frame)

    def drop(self, frame: Frame) -> None:
        """A frame that had gone in was dropped upstream."""
        self.in_bytes -= data_size(frame.data)
        self._pass_time(frame)

    def _pass_time(self, frame: Frame) -> None:
        if frame.pts is not None:
            self.out_ns = max(self.out_ns, frame.pts + self.out_offset_ns + (frame.duration or 0))

    def empty(self) -> None:
        """The line was emptied, the next timestamp begins anew; called downstream or when nothing streams."""
        self.out_bytes = self.in_bytes
        self.out_events = self.in_events - sum(not isinstance(item, Frame) for item in tuple(self._items))
        self.has_begun = False
        self.out_ns = self.in_ns
