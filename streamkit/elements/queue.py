"""queue: a bounded thread boundary."""

from __future__ import annotations

import enum
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.flow.caps import Caps
from streamkit.flow.events import EOS, EosEvent, Event
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream, FlowStop, Flushing

WAIT_S = 0.5  # longest sleep between looks at `stopping`, should a wake-up be missed


class Leaky(enum.StrEnum):
    """Which frame a full queue gives up."""

    NO = "no"
    UPSTREAM = "upstream"
    DOWNSTREAM = "downstream"


class _Drained(Exception):
    """EOS has been handed over."""


class Queue(Element):
    """Lets what follows run in a thread of its own; holds frames up to three limits.

    Example:
        fakesrc num-buffers=100 ! queue max-size-buffers=10 ! fakesink
    """

    sink = src = "ANY"

    max_size_buffers: int = Property(200, min=0, live=True, doc="Frames held at most; 0 is no limit.")
    max_size_bytes: int = Property(
        10485760, min=0, live=True, unit="bytes", doc="Bytes held at most; 0 is no limit."
    )
    max_size_time: int = Property(
        1_000_000_000, min=0, live=True, unit="ns", doc="Time held at most, by pts; 0 is no limit."
    )
    leaky: Leaky = Property(Leaky.NO, live=True, doc="Which frame a full queue drops instead of waiting.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._items: deque[Frame | Event] = deque()
        self._lock = threading.Lock()
        self._not_empty = threading.Condition(self._lock)
        self._not_full = threading.Condition(self._lock)
        self._buffers = 0
        self._bytes = 0
        self._last_in_ns = self._last_out_ns = 0
        self.highest_level_buffers = self.highest_level_bytes = self.highest_level_time = 0
        self._stop: FlowStop | None = None
        super().__init__(name, **properties)

    # Levels.

    @property
    def current_level_buffers(self) -> int:
        """Frames held now."""
        return self._buffers

    @property
    def current_level_bytes(self) -> int:
        """Bytes held now."""
        return self._bytes

    @property
    def current_level_time(self) -> int:
        """Time between the oldest and the newest frame held, ns."""
        return max(0, self._last_in_ns - self._last_out_ns) if self._buffers else 0

    def _is_full(self) -> bool:
        return bool(
            (self.max_size_buffers and self._buffers >= self.max_size_buffers)
            or (self.max_size_bytes and self._bytes >= self.max_size_bytes)
            or (self.max_size_time and self.current_level_time >= self.max_size_time)
        )

    def property_changed(self, name: str) -> None:
        """A limit raised makes room for who waits."""
        with self._lock:
            self._not_full.notify_all()

    # The upstream side.

    def query_caps(self, pad: Pad) -> Caps:
        """What the other side can carry."""
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of the sink pad."""
        return self._put

    def _put(self, frame: Frame) -> None:
        with self._lock:
            if self._stop is not None:
                raise type(self._stop)(self.name)
            if self._is_full() and not self._make_room():
                return
            if not self._buffers and frame.pts is not None:
                self._last_out_ns = frame.pts
            self._items.append(frame)
            self._buffers += 1
            self._bytes += _size(frame)
            if frame.pts is not None:
                self._last_in_ns = frame.pts + (frame.duration or 0)
            if self._buffers > self.highest_level_buffers or self._bytes > self.highest_level_bytes:
                self._note_highest()
            self._not_empty.notify()

    def _note_highest(self) -> None:
        """Remembers how full it has been; asked for only where frames or bytes go beyond what they were."""
        self.highest_level_buffers = max(self.highest_level_buffers, self._buffers)
        self.highest_level_bytes = max(self.highest_level_bytes, self._bytes)
        self.highest_level_time = max(self.highest_level_time, self.current_level_time)

    def _make_room(self) -> bool:
        """Waits or drops as `leaky` says; False if the new frame is the one given up."""
        if self.leaky is Leaky.UPSTREAM:
            self.count_drop("queue full, newest dropped")
            return False
        while self._is_full():
            if self.leaky is Leaky.DOWNSTREAM:
                self._drop_oldest()
                continue
            self._not_full.wait(WAIT_S)
            if self._stop is not None:
                raise type(self._stop)(self.name)
            if self.stopping.is_set():
                raise Flushing(self.name)
        return True

    def _drop_oldest(self) -> None:
        for index, item in enumerate(self._items):
            if isinstance(item, Frame):
                del self._items[index]
                self._count_out(item)
                self.count_drop("queue full, oldest dropped")
                return

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Lines the event up behind the frames; events do not count against the limits."""
        with self._lock:
            self._items.append(event)
            self._not_empty.notify()

    # The downstream side.

    def prepare_run(self) -> None:
        """Forgets an earlier run."""
        self._items.clear()
        self._buffers = self._bytes = self._last_in_ns = self._last_out_ns = 0
        self.highest_level_buffers = self.highest_level_bytes = self.highest_level_time = 0
        self._stop = None

    def stream(self) -> None:
        """The body of the queue's thread: hands over frames and events in order, until EOS."""
        src = self.pads["src"]
        try:
            while True:
                # No name here holds the frame: downstream may then be its sole owner.
                src.push(self._next_frame(src))
        except _Drained:
            return
        except EndOfStream as stop:
            self._refuse(stop)
            src.send_event(EOS)
        except FlowStop as stop:
            self._refuse(stop)
            raise
        except Exception:
            self._refuse(EndOfStream(self.name))
            raise

    def _next_frame(self, src: Pad) -> Frame:
        """The oldest frame; events before it are sent on, EOS ends the stream."""
        while True:
            item = self._get()
            if isinstance(item, Frame):
                return item
            src.send_event(item)
            if isinstance(item, EosEvent):
                raise _Drained

    def _get(self) -> Frame | Event:
        with self._lock:
            while not self._items:
                if self.stopping.is_set():
                    raise Flushing(self.name)
                self._not_empty.wait(WAIT_S)
            if self.stopping.is_set():
                raise Flushing(self.name)
            item = self._items.popleft()
            if isinstance(item, Frame):
                self._count_out(item)
                self._not_full.notify()
            return item

    def _count_out(self, frame: Frame) -> None:
        self._buffers -= 1
        self._bytes -= _size(frame)
        if frame.pts is not None:
            self._last_out_ns = frame.pts + (frame.duration or 0)

    def _refuse(self, stop: FlowStop) -> None:
        """Drops what is held and answers every later push with the reason why streaming ended."""
        with self._lock:
            self._stop = stop
            self._items.clear()
            self._buffers = self._bytes = 0
            self._not_full.notify_all()

    def interrupt(self) -> None:
        """Wakes both sides."""
        with self._lock:
            self._not_empty.notify_all()
            self._not_full.notify_all()

    def stop(self) -> None:
        """Lets go of what is still held."""
        self._items.clear()
        self._buffers = self._bytes = 0


def _size(frame: Frame) -> int:
    data = frame.data
    size = getattr(data, "nbytes", None)
    if size is None:
        size = getattr(data, "size", None)
    if isinstance(size, int):
        return size
    return len(data) if isinstance(data, bytes | bytearray | str) else 0
