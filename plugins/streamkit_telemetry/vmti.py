"""MISB ST 0903: moving targets of a frame as a VMTI local set, tag 74 of a UAS local set.

Pixels are numbered from 1 in the top-left corner, row by row.

Source: MISB ST 0903.4, "VMTI LS", "VTarget Pack", "VTracker LS"; a set within ST 0601 has neither time stamp
nor checksum of its own.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from streamkit_telemetry.st0601writer import ber_length, ber_oid, element, shortest

if TYPE_CHECKING:
    from streamkit import Track

VMTI_TAG = 74  # of ST 0601
VERSION = 4  # of ST 0903
MAX_NAME_LENGTH = 32
# More would not fit into one packet of a transport stream; those of the highest scores are reported.
MAX_TARGETS = 1000


class DetectionStatus(enum.IntEnum):
    """Detection status of a VTracker set."""

    INACTIVE = 0
    MOVING = 1
    DROPPED = 2
    STOPPED = 3
    COASTING = 4


STATUSES: dict[str, DetectionStatus] = {
    "confirmed": DetectionStatus.MOVING,
    "coasting": DetectionStatus.COASTING,
    "lost": DetectionStatus.DROPPED,
}


def encode_vmti(tracks: Sequence[Track], utc_us: int | None, size: tuple[int, int], system: str) -> bytes:
    """The value of a VMTI local set.

    Args:
        tracks: confirmed, coasting and lost ones are reported; one wholly outside the frame is skipped.
        utc_us: of the frame, microseconds; None if unknown.
        size: width and height of the frame, px.
        system: name of what found them.
    """
    reported = [track for track in tracks if track.state in STATUSES]
    if len(reported) > MAX_TARGETS:
        reported = sorted(reported, key=lambda track: track.score, reverse=True)[:MAX_TARGETS]
    packs = [pack for track in reported if (pack := _vtarget(track, utc_us, *size)) is not None]
    detected = sum(track.state != "lost" for track in tracks)
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


def _vtarget(track: Track, utc_us: int | None, width: int, height: int) -> bytes | None:
    """A VTarget pack; its box is upright. None where the target is outside the frame."""
    cosine, sine = abs(math.cos(track.angle)), abs(math.sin(track.angle))
    across = (track.length * cosine + track.width * sine) / 2
    down = (track.length * sine + track.width * cosine) / 2
    if not all(map(math.isfinite, (track.x, track.y, across, down))):
        return None
    left, right = _pixels(track.x - across, track.x + across, width)
    top, bottom = _pixels(track.y - down, track.y + down, height)
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
    """Status, and when the target was first and last seen."""
    items = element(2, bytes([STATUSES[track.state]]))
    if utc_us is not None:
        items += element(3, max(0, utc_us - track.age_ns // 1000).to_bytes(8, "big"))
        if track.state == "confirmed":
            items += element(4, utc_us.to_bytes(8, "big"))
    return items


def _pixels(low: float, high: float, count: int) -> tuple[int, int]:
    """First and last pixel whose centre is between low and high, else the nearest to the middle."""
    first, last = math.ceil(low), math.floor(high)
    if first > last:
        first = last = math.floor((low + high) / 2 + 0.5)
    return max(first, 0), min(last, count - 1)


def _pixel_number(row: int, column: int, width: int) -> int:
    return row * width + column + 1
