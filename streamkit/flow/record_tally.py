"""RecordTally: what the frames of a run carried for their track records, and why nothing came of them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from streamkit.flow.metadata import Detections, Pose, Tracks
from streamkit.flow.record import TRACKS_CAPS

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame


class RecordTally:
    """Counts frames, and those with each kind of metadata."""

    def __init__(self) -> None:
        self._frames = 0
        self._with: Counter[type] = Counter()
        self._targets = self._positions = 0

    def note(self, frame: Frame, *, has_position: bool = False) -> None:
        """Notes a frame, and whether a target of it has ground coordinates."""
        tracks = frame.get(Tracks)
        if tracks is None and frame.caps.name == TRACKS_CAPS.name:
            return  # a record that another tracker made
        self._frames += 1
        self._positions += has_position
        for kind in (Detections, Pose):
            self._with[kind] += kind in frame.metadata
        if tracks is not None:
            self._with[Tracks] += 1
            self._targets += bool(tracks.tracks)

    def shortfall(self, *, needs_positions: bool = False, has_altitude: bool = True) -> str:
        """Why no record of the run has a target (with ground coordinates, if needed), or ""."""
        frames = f"of {self._frames} frames"
        if not self._frames or self._positions or (self._targets and not needs_positions):
            return ""
        if not self._with[Tracks]:
            return f"none {frames} carried tracks; put particletrack before it"
        if not self._targets:
            if self._with[Detections]:
                return (
                    f"no target in any {frames}, though detections were looked for" if needs_positions else ""
                )
            return f"no target in any {frames}: none carried detections; put framediff before particletrack"
        if not self._with[Pose]:
            return f"no target has a position: none {frames} carried a pose; pair telemetry with posesync"
        if not has_altitude:
            return "no target has a position: set ground-altitude, the altitude of the ground"
        return "no target has a position: none was confirmed where its line of sight meets the ground"
