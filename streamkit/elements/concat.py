"""concat: one stream after another."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.events import CapsEvent, Event, FlushStart, FlushStop, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.segment import Segment
from streamkit.flow.signals import EndOfStream, Flushing

WAIT_S = 0.5


class Concat(Combine):
    """Passes on its first input until that ends, then the second, and so on; later inputs wait.

    Example:
        concat name=c ! fakesink  fakesrc num-buffers=3 ! c.  fakesrc num-buffers=5 ! c.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(
        None, read=lambda concat: concat._active_name(), doc="Name of the input whose turn it is."
    )
    adjust_base: bool = Property(
        True, live=True, doc="Let each input's running time begin where that of the one before it ended."
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._moved = threading.Condition()
        self._end_ns = 0
        super().__init__(name, **properties)

    def start(self) -> None:
        """Nothing has been passed on."""
        self._end_ns = 0

    def combine(self, pad_name: str, frame: Frame) -> Frame:
        """The frame: its turn has come."""
        return frame

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a pad; it waits for the pads before it to end."""
        receive = super().receiver(pad)

        def in_turn(frame: Frame) -> None:
            if pad.is_eos:
                raise EndOfStream(self.name)
            if self._source is not pad:
                self._wait_for_turn(pad)
            receive(frame)
            if frame.pts is not None:
                end_ns = frame.pts + (frame.duration or 0)
                self._end_ns = max(self._end_ns, self.src_pad.segment.running_time_ns(end_ns))

        return in_turn

    def switched(self, pad: Pad) -> None:
        """The segment of the new input, moved to the end of what has been passed on."""
        segment = pad.segment
        if self.adjust_base and self._end_ns:
            segment = Segment(segment.start_ns, segment.stop_ns, self._end_ns)
        if segment != self.src_pad.segment:
            self.src_pad.send_event(SegmentEvent(segment))

    def _wait_for_turn(self, pad: Pad) -> None:
        with self._moved:
            while self._active() is not pad:
                if self.stopping.is_set() or self.is_flushing or pad.name not in self.pads:
                    raise Flushing(self.name)
                with self.waiting():
                    self._moved.wait(WAIT_S)

    def _active(self) -> Pad | None:
        return next((pad for pad in list(self.pads.values()) if not pad.is_src and not pad.is_eos), None)

    def _active_name(self) -> str | None:
        active = self._active()
        return None if active is None else active.name

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS of the active input gives the next its turn; events wait for their turn too."""
        if not isinstance(event, CapsEvent | SegmentEvent | FlushStart | FlushStop):
            self._wait_for_turn(pad)
        super().receive_event(pad, event)
        self._wake()

    def release_pad(self, pad: Pad) -> None:
        """Takes an input away; the next has its turn."""
        super().release_pad(pad)
        self._wake()

    def flush(self, *, begins: bool) -> None:
        """A flush ends waits for a turn."""
        super().flush(begins=begins)
        self._wake()

    def interrupt(self) -> None:
        """Wakes who waits for a turn."""
        self._wake()

    def _wake(self) -> None:
        with self._moved:
            self._moved.notify_all()
