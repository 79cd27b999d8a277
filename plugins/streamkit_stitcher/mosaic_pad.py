"""The pad `mosaic`: events in order, and the newest frame only, pushed from a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable

from streamkit import CapsEvent, EndOfStream, EosEvent, Event, FlushEvent, Flushing, Frame, GapEvent, Pad
from streamkit.handoff.bounded_queue import BoundedQueue

_PUSH_LIMIT_S = 2.0


class MosaicPad:
    """Pushes frames through a pad from its own thread, so that a slow consumer never delays the stream.

    A newer frame replaces one that still waits. Events are sent before the next frame or EOS, of each type
    the newest only. The base's forwarding to several src pads does not fit: it pushes from the streaming
    thread.

    Args:
        find_pad: returns the pad, or None while it is not linked.
        frame_dropped: called for each frame that is replaced.
    """

    def __init__(self, find_pad: Callable[[], Pad | None], frame_dropped: Callable[[], None]) -> None:
        self._find_pad = find_pad
        self._frame_dropped = frame_dropped
        self._frames: BoundedQueue[Frame] = BoundedQueue(capacity=1)
        self._events: dict[type[Event], Event] = {}
        self._lock = threading.Lock()
        self._pushing = threading.Lock()
        self._is_flushing = self._has_ended = False

    def put(self, frame: Frame) -> None:
        """Queues a frame, replacing a queued one; ignored after EOS or during a flush."""
        with self._lock:
            if not (self._has_ended or self._is_flushing) and self._frames.put(frame):
                self._frame_dropped()

    def put_event(self, event: Event) -> None:
        """Queues an event, replacing a queued one of its type; ignored after EOS."""
        with self._lock:
            if self._has_ended:
                return
            if isinstance(event, EosEvent):
                self._has_ended = True
                self._frames.end()
            else:
                self._events.pop(type(event), None)
                self._events[type(event)] = event

    def flush(self, event: FlushEvent) -> None:
        """Forwards the start or stop of a flush at once; queued frames are dropped."""
        pad = self._find_pad()
        if event.begins:
            with self._lock:
                self._is_flushing = True
                self._frames.clear()
                self._frames.reopen()
                self._events.pop(GapEvent, None)
        elif self._pushing.acquire(timeout=_PUSH_LIMIT_S):
            # The frame that was being pushed when the flush began has returned.
            self._pushing.release()
        if pad is not None:
            pad.send_event(event)
        if not event.begins:
            with self._lock:
                self._is_flushing = False
                if self._has_ended:
                    self._frames.end()

    def serve(self, stopping: threading.Event) -> None:
        """The body of the thread: sends frames and events until EOS or until the pipeline stops."""
        while not stopping.is_set():
            frame = self._frames.get(wait_s=None, cancelled=stopping)
            if frame is None and not self._frames.is_over:
                continue
            pad = self._find_pad()
            if not (frame is not None if pad is None else self._send(pad, frame)):
                self.put_event(EosEvent())
                return

    def wake(self) -> None:
        """Wakes the thread, to check whether the pipeline stops."""
        self._frames.wake()

    def _send(self, pad: Pad, frame: Frame | None) -> bool:
        """Sends queued events, then the frame after its caps, or EOS; returns whether frames may follow."""
        with self._pushing:
            with self._lock:
                if self._is_flushing:
                    return True
                events, self._events = self._events, {}
            for event in events.values():
                pad.send_event(event)
            try:
                if frame is not None:
                    if pad.caps != frame.caps:
                        pad.send_event(CapsEvent(frame.caps))
                    pad.push(frame)
                    return True
            except EndOfStream:
                pass
            except Flushing:
                return True
        pad.send_event(EosEvent())
        return False
