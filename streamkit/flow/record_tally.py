"""RecordTally: counts the metadata of a run's frames, and says why their track records have no targets."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from streamkit.flow.ground import ground_positions
from streamkit.flow.metadata import Detections, Tracks
from streamkit.flow.record import TRACKS_CAPS
from streamkit.geometry.pose import Pose
from streamkit.geometry.track import SHOWN_STATES

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame
    from streamkit.flow.record import TrackRecord


class RecordTally:
    """Counts frames, and those with each kind of metadata.

    Args:
        needs_positions: whether a run without ground coordinates is to be explained, too.
    """

    def __init__(self, *, needs_positions: bool = False) -> None:
        self._needs_positions = needs_positions
        self._frames = self._records = 0
        self._with: Counter[type] = Counter()
        self._targets = self._shown = self._positions = 0
        self._unlocated: Counter[str] = Counter()

    def note(
        self, frame: Frame, record: TrackRecord | None = None, ground_altitude_m: float | None = None
    ) -> None:
        """Counts a frame, and whether a target of its record has ground coordinates."""
        tracks = frame.get(Tracks)
        self._positions += record is not None and any(target.geo is not None for target in record.tracks)
        if tracks is None and frame.caps.name == TRACKS_CAPS.name:
            self._records += 1  # of an earlier run: its tracker has said what was missing
            return
        self._frames += 1
        for kind in (Detections, Pose):
            self._with[kind] += kind in frame.metadata
        if tracks is not None:
            self._with[Tracks] += 1
            self._targets += bool(tracks.tracks)
            self._shown += any(track.state in SHOWN_STATES for track in tracks.tracks)
            if self._needs_positions and tracks.tracks and not self._positions:
                self._unlocated[ground_positions(frame, ground_altitude_m)[1]] += 1

    def remark(self) -> str:
        """A remark if frames were searched and no target was confirmed, which is no fault; else ""."""
        if self._shown or not self._with[Tracks] or self.shortfall():
            return ""
        if self._targets:
            return f"no target was confirmed; {self._targets} of {self._frames} frames have tentative ones"
        return f"no target in any of {self._frames} frames"

    def shortfall(self) -> str:
        """Why no record of the run has a target (with ground coordinates, if needed), or ""."""
        needs_positions, frames = self._needs_positions, f"of {self._frames} frames"
        if self._positions or (self._targets and not needs_positions):
            return ""
        if self._records and needs_positions:
            return (
                f"no target in {self._records} records has a position; pair telemetry with posesync when "
                "they are made, and set ground-altitude there where it does not tell the height above ground"
            )
        if not self._frames:
            return ""
        if not self._with[Tracks]:
            return f"none {frames} carried tracks; put particletrack before it"
        if not self._targets and not self._with[Detections]:
            return f"no target in any {frames}: none carried detections; put framediff before particletrack"
        if not self._targets:
            return f"no target in any {frames}, though detections were looked for" if needs_positions else ""
        if not self._with[Pose]:
            return f"no target has a position: none {frames} carried a pose; pair telemetry with posesync"
        reason = self._unlocated.most_common(1)[0][0]
        return f"no target has a position: {reason or 'none was confirmed'}"
