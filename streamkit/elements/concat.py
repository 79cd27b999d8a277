"""concat: concatenates streams."""

from __future__ import annotations

from collections.abc import Callable

from typing_extensions import override

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.events import CapsEvent, EndOfStream, Event, FlushEvent, Segment, SegmentEvent
from streamkit.flow.frame import Frame


class Concat(Combine):
    """Forwards its first input until EOS, then the second, and so on; later inputs wait.

    Example:
        concat name=c ! fakesink  fakesrc num-buffers=3 ! c.  fakesrc num-buffers=5 ! c.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(None, read=lambda c: c._active_name(), doc="Name of the current input.")
    adjust_base: bool = Property(True, live=True, doc="Start each input where the previous one ended.")

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._end_ns = 0

    @override
    def combine(self, pad_name: str, frame: Frame) -> Frame:
        return frame

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function called with each frame of a pad; it waits until the pads before it have ended."""
        receive = super().receiver(pad)

        def in_turn(frame: Frame) -> None:
            if pad.is_eos:
                raise EndOfStream(self.name)
            if self._last_input is not pad:
                self._wait_for_turn(pad)
            receive(frame)
            if frame.pts is not None:
                end_ns = frame.pts + (frame.duration or 0)
                self._end_ns = max(self._end_ns, self.src_pad.segment.running_time_ns(end_ns))

        return in_turn

    def send_segment(self, pad: Pad) -> None:
        """Sends the segment of the new input, shifted to the end of the previous one."""
        segment = pad.segment
        if self.adjust_base and self._end_ns:
            segment = Segment(segment.start_ns, segment.stop_ns, self._end_ns)
        if segment != self.src_pad.segment:
            self.src_pad.send_event(SegmentEvent(segment))

    def _wait_for_turn(self, pad: Pad) -> None:
        with self.changed:
            self.wait_for(lambda: self._active() is pad or pad.name not in self.pads)
        if pad.name not in self.pads:
            raise EndOfStream(self.name)

    def _active(self) -> Pad | None:
        return next((pad for pad in list(self.pads.values()) if not pad.is_src and not pad.is_eos), None)

    def _active_name(self) -> str | None:
        return getattr(self._active(), "name", None)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Makes events wait for their turn; EOS of the current input starts the next one."""
        if not (pad.is_eos or isinstance(event, CapsEvent | SegmentEvent | FlushEvent)):
            self._wait_for_turn(pad)
        super().receive_event(pad, event)
        self.wake()

    def release_pad(self, pad: Pad) -> None:
        """Removes an input; the next one may become current."""
        super().release_pad(pad)
        self.wake()
