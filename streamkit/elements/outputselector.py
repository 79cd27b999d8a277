"""output-selector: sends frames to one of several branches."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from typing_extensions import override

from streamkit.element.branching import Split, check_active_pad
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.element.property_text import Choice
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import SegmentEvent
from streamkit.flow.frame import Frame


class Negotiation(Choice):
    """Whose caps bound upstream."""

    NONE = "none", 0, "None"
    ALL = "all", 1, "All"
    ACTIVE = "active", 2, "Active"


class OutputSelector(Split):
    """Sends each frame to the active branch, initially the first, and events to every branch.

    Example:
        fakesrc num-buffers=3 ! output-selector name=s  s. ! fakesink  s. ! fakesink
    """

    sink = "ANY"
    templates = (PadTemplate("src_%u", Direction.SRC, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(None, live=True, doc="Name of the active branch; unset is the first.")
    pad_negotiation_mode: Negotiation = Property(
        Negotiation.ALL, doc="Caps that bound upstream: none, those of all branches, or of the active one."
    )
    resend_latest: bool = Property(False, live=True, doc="Send the newest frame again after a switch.")

    @override
    def start(self) -> None:
        check_active_pad(self, self.active_pad, "src_%u")  # every branch is known now

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._latest: Frame | None = None
        self._switched = False

    def _active(self) -> Pad | None:
        return self.pads.get(self.active_pad or "") or next(self.src_pads(), None)

    def query_caps(self, pad: Pad) -> Caps:
        """Caps by `pad-negotiation-mode` for the sink pad; upstream's caps for a src pad."""
        if pad.is_src:
            return self.pads["sink"].peer_caps()
        if self.pad_negotiation_mode is Negotiation.NONE:
            return ANY
        if self.pad_negotiation_mode is Negotiation.ALL:
            return super().query_caps(pad)
        active = self._active()
        return ANY if active is None else active.peer_caps()

    @override
    def split(self, frame: Frame) -> Mapping[str, Frame]:
        active = self._active()
        return {} if active is None else {active.name: frame}

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        receive = super().receiver(pad)

        def remember(frame: Frame) -> None:
            if self._switched:
                self._resend()
            self._latest = frame if self.resend_latest else None
            receive(frame)

        return remember

    def _resend(self) -> None:
        self._switched = False
        latest, active = self._latest, self._active()
        if latest is None or active is None:
            return
        latest = active.announce_caps(latest)
        if active.segment != self.pads["sink"].segment:
            active.send_event(SegmentEvent(self.pads["sink"].segment))
        active.push(latest)

    def property_changed(self, name: str) -> None:
        """Switches branches; renegotiates if the active branch bounds upstream."""
        if name != "active_pad":
            return
        check_active_pad(self, self.active_pad, "src_%u")
        if not self.is_playing:
            return
        self._switched = self.resend_latest
        if self.pad_negotiation_mode is Negotiation.ACTIVE:
            self.reconfigure()

    @override
    def stop(self) -> None:
        self._latest = None
