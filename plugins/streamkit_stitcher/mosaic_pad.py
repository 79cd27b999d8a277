"""What waits to leave through the pad `mosaic`: events in order, and of the pictures the newest only."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from streamkit import (
    CapsEvent,
    EndOfStream,
    EosEvent,
    Event,
    Flushing,
    FlushStart,
    Frame,
    GapEvent,
)

_LOOK_S: Final = 0.5
_PARK_S: Final = 2.0


class MosaicPad:
    """Sends through a pad in a thread of its own, so that whoever looks at the mosaic holds up nobody.

    A picture that is still waiting when a newer one comes is skipped.

    Args:
        find: gives the pad, or None while nobody is linked to it.
        skipped: told of each picture that is skipped.
    """

    def __init__(self, find: Callable[[], Any], skipped: Callable[[], None]) -> None:
        self._find = find
        self._skipped = skipped
        self._items: deque[Frame | Event] = deque()
        self._changed = threading.Condition()
        self._pushing = threading.Lock()
        self._is_flushing = self._has_ended = False

    def put(self, frame: Frame) -> None:
        """Lines a picture up in the place of one that waits; none after the end or in a flush."""
        with self._changed:
            if self._has_ended or self._is_flushing:
                return
            older = next((item for item in self._items if isinstance(item, Frame)), None)
            if older is not None:
                self._items = deque(item for item in self._items if item is not older)
                self._skipped()
            self._items.append(frame)
            self._changed.notify_all()

    def put_event(self, event: Event) -> None:
        """Lines an event up behind what waits; of events of a kind in a row the newest is enough."""
        with self._changed:
            if self._has_ended:
                return
            while self._items and type(self._items[-1]) is type(event):
                self._items.pop()
            self._items.append(event)
            self._has_ended = isinstance(event, EosEvent)
            self._changed.notify_all()

    def flush(self, event: Event) -> None:
        """Passes the start or stop of a flush at once; nothing from before it is sent after its stop."""
        pad = self._find()
        begins = isinstance(event, FlushStart)
        if begins:
            with self._changed:
                self._is_flushing, self._has_ended = True, False
                held = [item for item in self._items if not isinstance(item, Frame | GapEvent | EosEvent)]
                self._items = deque({type(item): item for item in held}.values())
        elif self._pushing.acquire(timeout=_PARK_S):
            # The picture that was on its way when the flush began has come back.
            self._pushing.release()
        if pad is not None:
            pad.send_event(event)
        if not begins:
            with self._changed:
                self._is_flushing = False
                self._changed.notify_all()

    def serve(self, stopping: threading.Event) -> None:
        """The body of the thread: sends what comes until EOS has gone or the pipeline stops."""
        while True:
            item = self._take(stopping)
            if item is None:
                return
            pad = self._find()
            if pad is not None and not self._send(pad, item):
                item = EosEvent()
                self.put_event(item)
                pad.send_event(item)
            if isinstance(item, EosEvent):
                return

    def wake(self) -> None:
        """Has the thread look whether the pipeline stops."""
        with self._changed:
            self._changed.notify_all()

    def _take(self, stopping: threading.Event) -> Frame | Event | None:
        with self._changed:
            while not stopping.is_set():
                if self._items and not self._is_flushing:
                    return self._items.popleft()
                self._changed.wait(_LOOK_S)
        return None

    def _send(self, pad: Any, item: Frame | Event) -> bool:
        """Sends an event, or a picture with its caps before it; False where no picture is wanted any more."""
        if not isinstance(item, Frame):
            pad.send_event(item)
            return True
        with self._pushing:
            if self._is_flushing:
                return True
            try:
                if pad.caps != item.caps:
                    pad.send_event(CapsEvent(item.caps))
                pad.push(item)
            except EndOfStream:
                return False
            except Flushing:
                return True
        return True
