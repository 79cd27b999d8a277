"""capsfilter: lets one kind of frames through; written as caps between two `!`."""

from __future__ import annotations

from typing import Any

from streamkit.element.choice import Choice
from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame


class CapsChangeMode(Choice):
    """What happens to frames on their way when the caps change."""

    IMMEDIATE = "immediate", 0, "Only accept the current filter caps"
    DELAYED = "delayed", 1, "Temporarily accept previous filter caps"


class CapsFilter(Transform):
    """Restricts the caps on a link. Caps set while it plays make the source negotiate anew.

    Example:
        videotestsrc num-buffers=5 ! video/x-raw, format=GRAY8, width=320 ! fakesink
    """

    sink = src = "ANY"

    caps: Caps | None = Property(ANY, live=True, doc="What may pass; None is anything.")
    caps_change_mode: CapsChangeMode = Property(
        CapsChangeMode.IMMEDIATE,
        live=True,
        doc="Whether the caps before a change are accepted until upstream has sent new ones.",
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._filter = ANY
        self._previous: list[Caps] = []
        super().__init__(name, **properties)

    def start(self) -> None:
        """Nothing is left over from an earlier run."""
        self._previous = []

    def property_changed(self, name: str) -> None:
        """New caps: upstream is asked to negotiate anew before its next frame."""
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
        """The caps of the other pad: the same, within the filter; the filter's order rules."""
        possible = self._filter & caps
        for earlier in self._previous:
            possible = possible | (earlier & caps)
        return possible

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Caps that meet the newest filter end the patience with those before it."""
        if not (self._filter & sink_caps).is_empty:
            self._previous = []

    def is_passthrough(self) -> bool:
        """Frames pass unseen: negotiation has seen to their caps."""
        return True

    def transform(self, frame: Frame) -> Frame:
        """The same frame."""
        return frame
