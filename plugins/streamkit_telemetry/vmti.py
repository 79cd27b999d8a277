"""MISB ST 0903: moving targets of a frame as a VMTI local set, tag 74 of a UAS local set.

Pixels are numbered from 1 in the top-left corner, row by row.

Source: MISB ST 0903.4, "VMTI LS", "VTarget Pack", "VTracker LS"; a set within ST 0601 has neither time stamp
nor checksum of its own.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from streamkit_telemetry.st0601writer import ber_length, ber_oid, element, shortest

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


@dataclass(frozen=True, slots=True)
class VmtiTarget:
    """One target of a frame."""

    id: int  # number that stays the same from frame to frame
    status: DetectionStatus  # what it is doing
    centre: tuple[float, float]  # x, y, px; (0, 0) is the centre of the top-left pixel
    box: tuple[float, float, float, float]  # x0, y0, x1, y1 around it, px, on the same axes
    confidence: float  # 0 to 1
    first_seen_us: int | None = None  # UTC, microseconds; None if unknown
    last_seen_us: int | None = None  # UTC, microseconds; None if unknown


def encode_vmti(targets: Iterable[VmtiTarget], detected: int, size: tuple[int, int], system: str) -> bytes:
    """The value of a VMTI local set.

    Args:
        targets: those to report; one wholly outside the frame is skipped.
        detected: how many there are in all.
        size: width and height of the frame, px.
        system: name of what found them.
    """
    packs = [pack for target in _best(list(targets)) if (pack := _vtarget(target, *size)) is not None]
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


def _best(targets: Sequence[VmtiTarget]) -> Sequence[VmtiTarget]:
    if len(targets) <= MAX_TARGETS:
        return targets
    return sorted(targets, key=lambda target: target.confidence, reverse=True)[:MAX_TARGETS]


def _vtarget(target: VmtiTarget, width: int, height: int) -> bytes | None:
    """A VTarget pack; None where the target is outside the frame."""
    numbers = (*target.centre, *target.box)
    if not all(map(math.isfinite, numbers)):
        return None
    left, right = _pixels(target.box[0], target.box[2], width)
    top, bottom = _pixels(target.box[1], target.box[3], height)
    if left > right or top > bottom:
        return None
    items = []
    row, column = (math.floor(number + 0.5) for number in reversed(target.centre))
    is_inside = 0 <= row < height and 0 <= column < width
    if is_inside:
        items.append(element(1, shortest(_pixel_number(row, column, width))))
    items.append(element(2, shortest(_pixel_number(top, left, width))))
    items.append(element(3, shortest(_pixel_number(bottom, right, width))))
    if math.isfinite(target.confidence):
        items.append(element(5, bytes([round(100 * min(max(target.confidence, 0.0), 1.0))])))
    if is_inside:
        items += [element(19, shortest(row + 1)), element(20, shortest(column + 1))]
    items.append(element(104, _vtracker(target)))
    return ber_oid(target.id) + b"".join(items)


def _vtracker(target: VmtiTarget) -> bytes:
    times = {3: target.first_seen_us, 4: target.last_seen_us}
    return element(2, bytes([target.status])) + b"".join(
        element(tag, time_us.to_bytes(8, "big")) for tag, time_us in times.items() if time_us is not None
    )


def _pixels(low: float, high: float, count: int) -> tuple[int, int]:
    """First and last pixel whose centre is between low and high, else the nearest to the middle."""
    first, last = math.ceil(low), math.floor(high)
    if first > last:
        first = last = math.floor((low + high) / 2 + 0.5)
    return max(first, 0), min(last, count - 1)


def _pixel_number(row: int, column: int, width: int) -> int:
    return row * width + column + 1
