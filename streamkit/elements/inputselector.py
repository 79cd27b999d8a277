"""input-selector: one of several streams."""

from __future__ import annotations

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.events import EOS, CapsEvent, EosEvent, Event
from streamkit.flow.frame import Frame


class InputSelector(Combine):
    """Passes on the frames of the active input and drops the others'; the first input is active at first.

    Example:
        input-selector name=s ! fakesink  fakesrc num-buffers=3 ! s.  fakesrc num-buffers=3 ! s.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(
        None, live=True, doc="Name of the input to pass on; unset is the first."
    )

    def start(self) -> None:
        """Nothing has ended yet."""
        self._ended = False

    def _active(self) -> Pad | None:
        if self.active_pad is None:
            return next(self.sink_pads(), None)
        return self.pads.get(self.active_pad)

    def combine(self, pad_name: str, frame: Frame) -> Frame | None:
        """The frame, if it came in on the active pad."""
        active = self._active()
        if active is not None and active.name == pad_name:
            return frame
        self.count_drop("input not active")
        return None

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS counts on the active input; caps follow the frames; other events of the active input go on."""
        with self._lock:
            if isinstance(event, EosEvent):
                pad.is_eos = True
                self._end_if_active_has()
            elif not isinstance(event, CapsEvent) and pad is self._active():
                self.src_pad.send_event(event)

    def _end_if_active_has(self) -> None:
        active = self._active()
        if active is not None and active.is_eos and not self._ended:
            self._ended = True
            self.src_pad.send_event(EOS)

    def property_changed(self, name: str) -> None:
        """A change to an input that has ended ends the stream."""
        if name == "active_pad" and self.is_playing:
            with self._lock:
                self._end_if_active_has()
