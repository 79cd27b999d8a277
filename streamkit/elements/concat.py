"""concat: one stream after another."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.flow.caps import ANY
from streamkit.flow.events import EosEvent, Event
from streamkit.flow.frame import Frame
from streamkit.flow.signals import Flushing

WAIT_S = 0.5


class Concat(Combine):
    """Passes on its first input until that ends, then the second, and so on; later inputs wait.

    Example:
        concat name=c ! fakesink  fakesrc num-buffers=3 ! c.  fakesrc num-buffers=5 ! c.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._moved = threading.Condition()
        super().__init__(name, **properties)

    def combine(self, pad_name: str, frame: Frame) -> Frame:
        """The frame: its turn has come."""
        return frame

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a pad; it waits for the pads before it to end."""
        receive = super().receiver(pad)

        def in_turn(frame: Frame) -> None:
            self._wait_for_turn(pad)
            receive(frame)

        return in_turn

    def _wait_for_turn(self, pad: Pad) -> None:
        with self._moved:
            while self._active() is not pad:
                if self.stopping.is_set():
                    raise Flushing(self.name)
                self._moved.wait(WAIT_S)

    def _active(self) -> Pad | None:
        return next((pad for pad in self.sink_pads() if not pad.is_eos), None)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS of the active input gives the next its turn; EOS waits for its turn too."""
        if isinstance(event, EosEvent):
            self._wait_for_turn(pad)
        super().receive_event(pad, event)
        with self._moved:
            self._moved.notify_all()

    def interrupt(self) -> None:
        """Wakes who waits for a turn."""
        with self._moved:
            self._moved.notify_all()
