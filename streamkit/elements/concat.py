"""concat: concatenates streams."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from typing_extensions import override

from streamkit.element.base import Element
from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.pad_owner import walk
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.events import CapsEvent, EndOfStream, Event, FlushEvent, Segment, SegmentEvent
from streamkit.flow.frame import Frame

STALL_S = 5.0  # time without a frame after which an input that waits is reported
UNLIMITED = "max-size-buffers=0 max-size-bytes=0 max-size-time=0"


class Concat(Combine):
    """Forwards its first input until EOS, then the second, and so on; later inputs wait.

    An input that comes from the same `tee` as the one before it needs a `queue` without limits, which holds
    all of its frames until then. A warning names it where nothing moves for lack of it.

    Example:
        concat name=c ! fakesink  fakesrc num-buffers=3 ! c.  fakesrc num-buffers=5 ! c.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(
        None, read=lambda c: getattr(c._active(), "name", None), doc="Name of the current input."
    )
    adjust_base: bool = Property(True, live=True, doc="Start each input where the previous one ended.")

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._end_ns = 0
        self._latest_s = 0.0  # when the newest frame came whose turn it was

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
            self._latest_s = time.monotonic()
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
        began_s = time.monotonic()

        def is_over() -> bool:
            return self._active() is pad or pad.name not in self.pads

        def has_stalled() -> bool:
            return time.monotonic() > max(began_s, self._latest_s) + STALL_S and self.timing.running.is_set()

        with self.changed:
            self.wait_for(lambda: is_over() or has_stalled())
        if not is_over():
            self._warn_of_stall(pad)
        with self.changed:
            self.wait_for(is_over)
        if pad.name not in self.pads:
            raise EndOfStream(self.name)

    def _warn_of_stall(self, pad: Pad) -> None:
        """Says which queue is missing where a waiting input holds up the element that feeds both."""
        active = self._active()
        beyond = set() if active is None else set(_upstream(active))
        shared = next((element for element in _upstream(pad) if element in beyond), None)
        if active is not None and shared is not None:
            self.post_warning(
                f"{pad.name} waits for the end of {active.name}, and {shared.name} feeds both, so nothing "
                f"moves: put queue {UNLIMITED} between {shared.name} and {pad.name}, to hold its whole stream"
            )

    def _active(self) -> Pad | None:
        return next((pad for pad in list(self.pads.values()) if not pad.is_src and not pad.is_eos), None)

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


def _upstream(pad: Pad) -> Iterator[Element]:
    """The elements from which frames come to a sink pad, the nearest first."""
    return walk([] if pad.peer is None else [pad.peer.element], Element.upstream)
