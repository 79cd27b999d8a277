"""Rates, intervals, jitter and losses of a stream, from its packets."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

SECOND_NS = 1_000_000_000
SETTLE = 15  # the first packets come in one go while FFmpeg looks at the stream
JITTER_GAIN = 16


@dataclass(frozen=True, slots=True)
class PacketFacts:
    """One packet of the video.

    Attributes:
        pts: ns; None if unknown.
        arrival_ns: monotonic clock, ns.
        size: bytes.
        is_keyframe: whether decoding can begin with it.
    """

    pts: int | None
    arrival_ns: int
    size: int
    is_keyframe: bool


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurements of a run of packets; None where it was too short.

    Attributes:
        packets: seen.
        rate: frames per second, by the times of the packets.
        bit_rate: bit/s.
        keyframe_interval_s: longest time from key frame to key frame.
        keyframes: seen.
        jitter_ms: how unevenly packets arrive, as RFC 3550 counts it.
        missing: frames that the times say should be there.
        is_variable: whether the distances of frames vary by more than a tenth.
    """

    packets: int
    rate: float | None
    bit_rate: float | None
    keyframe_interval_s: float | None
    keyframes: int
    jitter_ms: float | None
    missing: int
    is_variable: bool


def measure(packets: Sequence[PacketFacts]) -> Measured:
    """Measures a run of packets in the order they came.

    Source: RFC 3550, section 6.4.1 (interarrival jitter).
    """
    times = sorted(packet.pts for packet in packets if packet.pts is not None)
    steps = [b - a for a, b in pairwise(times) if b > a]
    middle = statistics.median(steps) if steps else 0
    length = times[-1] - times[0] if steps else 0
    keys = [packet.pts for packet in packets if packet.is_keyframe and packet.pts is not None]
    distances = [b - a for a, b in pairwise(keys)]
    variable = sum(abs(step - middle) > 0.1 * middle for step in steps) > 0.1 * len(steps)
    missing = 0 if variable else sum(max(0, round(step / middle) - 1) for step in steps)
    return Measured(
        len(packets),
        len(steps) * SECOND_NS / length if length else None,
        sum(packet.size for packet in packets) * 8 * SECOND_NS / length if length else None,
        max(distances) / SECOND_NS if distances else None,
        len(keys),
        _jitter_ms(packets[SETTLE:]),
        missing,
        variable,
    )


def _jitter_ms(packets: Sequence[PacketFacts]) -> float | None:
    transits = [packet.arrival_ns - packet.pts for packet in packets if packet.pts is not None]
    if len(transits) < SETTLE:
        return None
    jitter = 0.0
    for before, after in pairwise(transits):
        jitter += (abs(after - before) - jitter) / JITTER_GAIN
    return jitter / 1e6
