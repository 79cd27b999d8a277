"""capsfilter: restricts the caps of a link; written as caps between two `!`."""

from __future__ import annotations

from typing_extensions import override

from streamkit.element.property import Property
from streamkit.element.property_text import Choice
from streamkit.element.transform import Transform
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame


class CapsChangeMode(Choice):
    """What happens to frames in flight when the caps change."""

    IMMEDIATE = "immediate", 0, "Only accept the current filter caps"
    DELAYED = "delayed", 1, "Temporarily accept previous filter caps"


class CapsFilter(Transform):
    """Restricts the caps of a link. Setting caps while playing makes the source renegotiate.

    Example:
        videotestsrc num-buffers=5 ! video/x-raw, format=GRAY8, width=320 ! fakesink
    """

    sink = src = "ANY"

    caps: Caps | None = Property(ANY, live=True, doc="Allowed caps; None is ANY.")
    caps_change_mode: CapsChangeMode = Property(
        CapsChangeMode.IMMEDIATE, live=True, doc="Whether previous caps are accepted until new ones arrive."
    )

    _filter: Caps = ANY

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._previous: list[Caps] = []

    def property_changed(self, name: str) -> None:
        """Makes upstream renegotiate after a change of caps."""
        if name != "caps":
            return
        if self.caps is None:
            self.caps = ANY
            return
        if self.is_playing and self.caps_change_mode is CapsChangeMode.DELAYED:
            self._previous.append(self._filter)
        self._filter = self.caps
        if self.is_playing:
            self.reconfigure()

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """Intersects caps with the filter, in the filter's order."""
        possible = self._filter & caps
        for earlier in self._previous:
            possible = possible | (earlier & caps)
        return possible

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Forgets previous caps once upstream meets the newest filter."""
        if self._filter.can_intersect(sink_caps):
            self._previous = []

    def is_passthrough(self) -> bool:
        """Always: negotiation has checked the caps."""
        return True

    @override
    def transform(self, frame: Frame) -> Frame:
        return frame
