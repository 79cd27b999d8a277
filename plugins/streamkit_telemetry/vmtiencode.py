"""vmtiencode: tracks to MISB telemetry."""

from __future__ import annotations

import math

from typing_extensions import override

from streamkit import Caps, Frame, Pose, Property, Track, Tracks, TrackState, Transform
from streamkit_telemetry.st0601writer import (
    element,
    encode_pose,
    encode_time,
    encode_version,
    local_set_packet,
)
from streamkit_telemetry.vmti import VMTI_TAG, DetectionStatus, VmtiTarget, encode_vmti
from streamkit_telemetry_formats.sample import POSE_FIELDS, Sample

KLV_CAPS = "meta/x-klv, parsed=(boolean)false"
STATUSES = {
    TrackState.CONFIRMED: DetectionStatus.MOVING,
    TrackState.COASTING: DetectionStatus.COASTING,
    TrackState.LOST: DetectionStatus.DROPPED,
}
LATEST_US = (1 << 64) - 1


class VmtiEncode(Transform):
    """Writes the tracks of each frame as a KLV packet: MISB ST 0601 with the moving targets of ST 0903 in it.

    Confirmed, coasting and lost tracks are reported with their centre, box, confidence, status and times; the
    pose that `posesync` upstream has attached is added unless it is stale. The time stamp is the
    frame's UTC of capture; without one it counts from 1970, which is warned about.

    Example:
        filesrc location=flight.ts ! tee name=t  t. ! queue ! packetsink name=p location=tracked.ts
            t. ! queue ! decode ! stitch ! framediff ! particletrack ! vmtiencode ! p.klv
    """

    sink = "video/x-raw"
    src = KLV_CAPS

    system_name: str = Property("streamkit", doc="VMTI System Name, at most 32 bytes.")

    @override
    def start(self) -> None:
        self._caps = Caps(KLV_CAPS)

    def transform(self, frame: Frame) -> Frame | None:
        """The packet of a frame; none where no tracker has looked at it."""
        tracks = frame.get(Tracks)
        if tracks is None:
            self.count_drop("no tracks")
            self.warn_once("no tracks come with the frames: put particletrack upstream")
            return None
        if frame.capture is None:
            self.warn_once("the frames have no time of capture: the packets' time stamps count from 1970")
            now_us, utc_us = (frame.pts or 0) // 1000, None
        else:
            now_us = utc_us = frame.capture.utc_ns // 1000
        now_us = min(max(now_us, 0), LATEST_US)
        size = frame.caps.integer("width"), frame.caps.integer("height")
        targets = [target_of(track, utc_us) for track in tracks.tracks if track.state in STATUSES]
        detected = sum(track.state is not TrackState.LOST for track in tracks.tracks)
        pose = frame.get(Pose)
        elements = [
            encode_time(now_us),
            encode_pose(sample_of(pose)) if pose is not None and not pose.is_stale else b"",
            encode_version(),
            element(VMTI_TAG, encode_vmti(targets, detected, size, self.system_name)),
        ]
        data = local_set_packet(b"".join(elements))
        return frame.replace(data=data, caps=self._caps, flags=0, metadata={})


def target_of(track: Track, utc_us: int | None) -> VmtiTarget:
    """A track as a VMTI target; its box is upright."""
    cosine, sine = abs(math.cos(track.angle)), abs(math.sin(track.angle))
    across = (track.length * cosine + track.width * sine) / 2
    down = (track.length * sine + track.width * cosine) / 2
    is_seen = track.state is TrackState.CONFIRMED
    return VmtiTarget(
        track.id,
        STATUSES[track.state],
        (track.x, track.y),
        (track.x - across, track.y - down, track.x + across, track.y + down),
        track.score,
        None if utc_us is None else max(0, utc_us - track.age_ns // 1000),
        utc_us if is_seen else None,
    )


def sample_of(pose: Pose) -> Sample:
    """The sample with the fields of a pose."""
    return Sample(0, **{name: getattr(pose, name) for name in POSE_FIELDS})
