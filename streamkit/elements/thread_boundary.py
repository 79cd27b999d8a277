"""Thread boundary: the half of a queue that streams in a thread of its own, and its flushes."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from streamkit.element.base import Element
from streamkit.element.pad import SPECIAL, WEIGHED, Pad
from streamkit.elements.callbacks import Callbacks
from streamkit.elements.levels import EMPTY, Levels
from streamkit.elements.wakeup import Wakeup
from streamkit.flow.events import EOS, EosEvent, Event, GapEvent, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.flow.signals import EndOfStream, FlowStop, Flushing, NotLinked

LOOK_S = 0.5  # longest sleep between looks at `stopping`, should a wake-up be missed
PARK_S = 2.0  # longest wait of a flush for the frame that is on its way downstream


class _Drained(Exception):
    """EOS has been handed over."""


class ThreadBoundary(Element):
    """Hands frames and events over from a line to the src pad, in a thread of its own.

    What fills the line is the derived element's: it appends to `_items` and wakes who sleeps. The plain case,
    frame after frame, is left to the chain behind it, which takes out of the line itself: see `Line`.

    Attributes:
        on_underrun: called with the element when it has run empty.
        on_running: called with the element when frames are there again after that.
    """

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_underrun = Callbacks()
        self.on_running = Callbacks()
        self._items: deque[Frame | Event] = deque()
        self._levels = Levels(self._items)
        self.items = self._items
        self.weigh_out = self._levels.weigh_out
        self._lock = threading.Lock()  # of the flags below, which seldom change
        self._refusal: type[FlowStop] | None = None  # no exception: its traceback would keep frames alive
        self._halted = self._thresholded = self._head_gap = self._contended = False
        self.care = 0
        self._tail_gap = False
        self._limit_buffers = sys.maxsize
        self._flushes = False
        self._upstream_sleeps = self._downstream_sleeps = False
        self._room = Wakeup()
        self._filled = Wakeup()
        self._parked = threading.Event()
        self._flush_over = threading.Event()
        self._thread_id = 0
        super().__init__(name, **properties)

    # What the derived element tells.

    def _may_read(self, taken: int = 0) -> bool:
        """Whether something may be handed on now; `taken` frames are out of the line already."""
        return bool(self._items) or taken > 0

    def _tell(self, callbacks: Callbacks) -> None:
        """Calls callbacks, unless the element is to be silent."""
        callbacks.emit(self)

    # Levels, for statistics.

    @property
    def highest_level_buffers(self) -> int:
        """The most frames held since streaming began."""
        return self._levels.highest_buffers

    @property
    def highest_level_bytes(self) -> int:
        """The most bytes held since streaming began."""
        return self._levels.highest_bytes

    @property
    def highest_level_time(self) -> int:
        """The longest running time held since streaming began, ns."""
        return self._levels.highest_ns

    def _set(self, **flags: bool) -> None:
        """Sets flags that one side heeds at its next frame: downstream by `care`, upstream by `alert`."""
        with self._lock:
            for name, value in flags.items():
                setattr(self, name, value)
            self._heed()
            is_alert = self._tail_gap or self._refusal is not None
            self._levels.most = 0 if is_alert else self._limit_buffers
            self._levels.alert = min(self._levels.most, self._levels.highest_buffers)

    def _heed(self) -> None:
        is_gated = self._halted or self._thresholded or self._contended
        has_events = self._levels.in_events != self._levels.out_events
        is_special = is_gated or has_events or self._head_gap or self._upstream_sleeps
        self.care = self.care & WEIGHED | (SPECIAL if is_special else 0)

    def _upstream_sleeps_now(self, sleeps: bool) -> None:
        with self._lock:
            self._upstream_sleeps = sleeps
            self._heed()

    def _wake(self) -> None:
        self._filled.set()
        self._room.set()

    # Flushes, in the flusher's thread.

    def flush(self, *, begins: bool) -> None:
        """Frames are refused from the start of a flush to its stop; at its stop those held are dropped."""
        if begins:
            self._parked.clear()
            self._flush_over.clear()
            self._flushes = True
            self._refusal = self._refusal or Flushing
            with contextlib.suppress(ValueError, IndexError):
                self._items.remove(EOS)
            super().flush(begins=True)
            self._set(_halted=True)
            self._wake()
            return
        if self._thread_id and self._thread_id != threading.get_ident():
            self._parked.wait(PARK_S)
        self._drop_all()
        super().flush(begins=False)

    def _finish_flush(self, event: Event) -> None:
        """Tells downstream of the end of the flush, then lets both sides go on."""
        self.pads["src"].send_event(event)
        if self._refusal is Flushing:
            self._refusal = None
        self._set(_halted=self.stopping.is_set())
        self._flush_over.set()

    def _drop_all(self) -> None:
        """Drops frames, gaps and all but the newest event of each kind, while nobody takes any."""
        held = list(self._items)
        self._items.clear()
        newest = {type(event): event for event in held if not isinstance(event, Frame | GapEvent)}
        self._items.extend(event for event in newest.values())
        self.count_drop("flushed", sum(isinstance(item, Frame) for item in held))
        self._levels.empty()
        self._set()

    # The downstream side.

    def prepare_run(self) -> None:
        """Forgets an earlier run."""
        self._items.clear()
        self._levels.reset()
        self._refusal = None
        self._flushes = False
        self.care = 0
        self._set(_halted=False, _head_gap=False, _tail_gap=False)

    def stream(self) -> None:
        """The body of the queue's thread: hands over frames and events in order, until EOS."""
        src = self.pads["src"]
        take = self._taker(src)
        self._thread_id = threading.get_ident()
        try:
            while True:
                try:
                    while True:
                        # No name here holds the frame: downstream may then be its sole owner.
                        src.push(take())
                        if src.pull is not None:
                            src.pull(self)
                except Flushing:
                    self._park()
        except _Drained:
            return
        except EndOfStream as stop:
            self._refuse(type(stop))
            src.send_event(EOS)
        except NotLinked as stop:
            had_ended = self.pads["sink"].is_eos
            self._refuse(type(stop))
            if had_ended:  # else the next push tells upstream, which knows whether it minds
                raise
        except FlowStop as stop:
            self._refuse(type(stop))
            raise
        except Exception:
            self._refuse(EndOfStream)
            raise
        finally:
            self._thread_id = 0
            self._parked.set()

    def _taker(self, src: Pad) -> Callable[[], Frame]:
        """The function that takes the oldest frame out; events before it are sent on."""
        levels, popleft = self._levels, self._items.popleft

        def take() -> Frame:
            while True:
                try:
                    item = popleft()
                except IndexError:
                    self._wait_for_items()
                    continue
                if type(item) is not Frame:
                    self._hand_on(src, item)
                    continue
                if self.care & SPECIAL:
                    if not self._may_pass(item):
                        continue
                    levels.weigh_out(item)
                    return self._marked(item) if self._head_gap else item
                if item.data is not EMPTY or item.pts is not None:
                    levels.weigh_out(item)
                return item

        return take

    def _may_pass(self, frame: Frame) -> bool:
        """Looks at what is special; False where the frame just taken has to wait for a threshold."""
        if self._halted:
            raise Flushing(self.name)
        if self._thresholded and not self._may_read(taken=1):
            self._items.appendleft(frame)
            self._wait_for_items()
            return False
        if self._upstream_sleeps:
            self._upstream_sleeps_now(False)
            self._room.set()
        return True

    def _marked(self, frame: Frame) -> Frame:
        """The first frame after others were dropped before it."""
        self._set(_head_gap=False)
        return frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)

    def _hand_on(self, src: Pad, event: Any) -> None:
        with self._lock:
            self._levels.out_events += 1
            self._heed()
        if self._halted:
            raise Flushing(self.name)
        if isinstance(event, SegmentEvent):
            self._levels.out_offset_ns = event.segment.running_time_ns(0)
        src.send_event(event)
        if isinstance(event, EosEvent):
            raise _Drained

    def _wait_for_items(self) -> None:
        """Waits until something may be handed on, or streaming is to stop."""
        if self._halted:
            raise Flushing(self.name)
        if not self._items:
            self._tell(self.on_underrun)
        while True:
            self._downstream_sleeps = True
            if self._may_read() or self._halted:
                break
            self._filled.wait(LOOK_S)
        self._downstream_sleeps = False
        self._tell(self.on_running)

    def _park(self) -> None:
        """Waits out a flush; where there is none, streaming ends."""
        if not self._flushes or self.stopping.is_set():
            raise Flushing(self.name)
        self._flushes = False
        self._parked.set()
        while not self._flush_over.wait(LOOK_S):
            if self.stopping.is_set():
                raise Flushing(self.name)

    def _refuse(self, stop: type[FlowStop]) -> None:
        """Drops what is held and answers every later push with the reason why streaming ended."""
        self._refusal = stop
        self._set()
        self._items.clear()
        self._levels.empty()
        self._room.set()

    def interrupt(self) -> None:
        """Wakes both sides, for good if the pipeline is stopping."""
        if self.stopping.is_set():
            self._set(_halted=True)
            self._flush_over.set()
        self._wake()

    def stop(self) -> None:
        """Lets go of what is still held."""
        self._items.clear()
        self._levels.empty()
