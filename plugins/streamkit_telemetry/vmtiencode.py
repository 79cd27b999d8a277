"""vmtiencode: tracks to MISB telemetry, the moving targets of ST 0903 as a VMTI local set in ST 0601.

Pixels are numbered from 1 in the top-left corner, row by row.

Source: MISB ST 0903.4, "VMTI LS", "VTarget Pack", "VTracker LS"; a set within ST 0601 has neither time stamp
nor checksum of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from typing_extensions import override

from streamkit import Caps, Frame, Pose, Property, Track, Tracks, TrackState, Transform
from streamkit.geometry.boxes import upright_sides
from streamkit_telemetry.st0601writer import (
    ber_length,
    ber_oid,
    element,
    encode_pose,
    encode_time,
    encode_version,
    local_set_packet,
    shortest,
)

KLV_CAPS = "meta/x-klv, parsed=(boolean)false"
LATEST_US = (1 << 64) - 1
VMTI_TAG = 74  # of ST 0601
VERSION = 4  # of ST 0903
MAX_NAME_LENGTH = 32
# More would not fit into one packet of a transport stream; those of the highest scores are reported.
MAX_TARGETS = 1000
# The detection status of a VTracker set: moving, coasting, dropped. Other tracks are not reported.
STATUSES = {TrackState.CONFIRMED: 1, TrackState.COASTING: 4, TrackState.LOST: 2}


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
        pose = frame.get(Pose)
        elements = [
            encode_time(now_us),
            encode_pose(pose) if pose is not None and not pose.is_stale else b"",
            encode_version(),
            element(VMTI_TAG, encode_vmti(tracks.tracks, utc_us, size, self.system_name)),
        ]
        data = local_set_packet(b"".join(elements))
        return frame.replace(data=data, caps=self._caps, flags=0, metadata={})


def encode_vmti(tracks: Sequence[Track], utc_us: int | None, size: tuple[int, int], system: str) -> bytes:
    """The value of a VMTI local set.

    Args:
        tracks: of the frame; one wholly outside it is skipped.
        utc_us: when it was captured, microseconds; None if unknown.
        size: width and height of the frame, px.
        system: name of what found them.
    """
    reported = [track for track in tracks if track.state in STATUSES]
    packs = [pack for track in _best(reported) if (pack := _vtarget(track, utc_us, *size)) is not None]
    detected = sum(track.state is not TrackState.LOST for track in tracks)
    series = b"".join(ber_length(len(pack)) + pack for pack in packs)
    name = system.encode()[:MAX_NAME_LENGTH].decode(errors="ignore").encode()
    return b"".join(
        [
            element(3, name) if name else b"",
            element(4, bytes([VERSION])),
            element(5, shortest(max(detected, len(packs)))),
            element(6, shortest(len(packs))),
            element(8, shortest(size[0])),
            element(9, shortest(size[1])),
            element(101, series) if packs else b"",
        ]
    )


def _best(tracks: Sequence[Track]) -> Sequence[Track]:
    if len(tracks) <= MAX_TARGETS:
        return tracks
    return sorted(tracks, key=lambda track: track.score, reverse=True)[:MAX_TARGETS]


def _vtarget(track: Track, utc_us: int | None, width: int, height: int) -> bytes | None:
    """A VTarget pack, with an upright box; None where the target is outside the frame."""
    across, down = upright_sides(track.length, track.width, track.angle)
    box = track.x - across / 2, track.x + across / 2, track.y - down / 2, track.y + down / 2
    if not all(map(math.isfinite, (track.x, track.y, *box))):
        return None
    (left, right), (top, bottom) = _pixels(*box[:2], width), _pixels(*box[2:], height)
    if left > right or top > bottom:
        return None
    items = []
    row, column = math.floor(track.y + 0.5), math.floor(track.x + 0.5)
    is_inside = 0 <= row < height and 0 <= column < width
    if is_inside:
        items.append(element(1, shortest(_pixel_number(row, column, width))))
    items.append(element(2, shortest(_pixel_number(top, left, width))))
    items.append(element(3, shortest(_pixel_number(bottom, right, width))))
    if math.isfinite(track.score):
        items.append(element(5, bytes([round(100 * min(max(track.score, 0.0), 1.0))])))
    if is_inside:
        items += [element(19, shortest(row + 1)), element(20, shortest(column + 1))]
    items.append(element(104, _vtracker(track, utc_us)))
    return ber_oid(track.id) + b"".join(items)


def _vtracker(track: Track, utc_us: int | None) -> bytes:
    """A VTracker set: the status, and when the target was seen first and, if it is seen now, last."""
    times_us = {} if utc_us is None else {3: max(0, utc_us - track.age_ns // 1000)}
    if utc_us is not None and track.state is TrackState.CONFIRMED:
        times_us[4] = utc_us
    status = element(2, bytes([STATUSES[track.state]]))
    return status + b"".join(element(tag, time_us.to_bytes(8, "big")) for tag, time_us in times_us.items())


def _pixels(low: float, high: float, count: int) -> tuple[int, int]:
    """First and last pixel whose centre is between low and high, else the nearest to the middle."""
    first, last = math.ceil(low), math.floor(high)
    if first > last:
        first = last = math.floor((low + high) / 2 + 0.5)
    return max(first, 0), min(last, count - 1)


def _pixel_number(row: int, column: int, width: int) -> int:
    return row * width + column + 1
