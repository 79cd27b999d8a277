"""Rates, intervals, jitter and losses of a stream, from its packets."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from av.codec.codec import UnknownCodecError
from av.error import FFmpegError
from av.video.frame import VideoFrame

from streamkit import SECOND_NS, Frame, FrameFlags
from streamkit_media.codecs import caps_parameters
from streamkit_media.container import reason_of
from streamkit_media.decoding.videodecoder import VideoDecoder

SETTLING_PACKETS = 15  # the first packets come in one go while FFmpeg looks at the stream
FEWEST_TRANSITS = 15
JITTER_GAIN = 16
DECODING_LIMIT_S = 5.0


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
        keyframes: seen, with a time or without.
        has_times: whether packets have times; a bare stream has none.
        jitter_ms: how unevenly packets arrive, as RFC 3550 counts it.
        missing: frames that the times say should be there.
        is_variable: whether the distances of frames vary by more than a tenth.
    """

    packets: int
    rate: float | None
    bit_rate: float | None
    keyframe_interval_s: float | None
    keyframes: int
    has_times: bool
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
    keyframe_times = [packet.pts for packet in packets if packet.is_keyframe and packet.pts is not None]
    distances = [b - a for a, b in pairwise(keyframe_times)]
    variable = sum(abs(step - middle) > 0.1 * middle for step in steps) > 0.1 * len(steps)
    missing = 0 if variable else sum(max(0, round(step / middle) - 1) for step in steps)
    return Measured(
        len(packets),
        len(steps) * SECOND_NS / length if length else None,
        sum(packet.size for packet in packets) * 8 * SECOND_NS / length if length else None,
        max(distances) / SECOND_NS if distances else None,
        sum(packet.is_keyframe for packet in packets),
        bool(times),
        _jitter_ms(packets[SETTLING_PACKETS:]),
        missing,
        variable,
    )


def _jitter_ms(packets: Sequence[PacketFacts]) -> float | None:
    transits = [packet.arrival_ns - packet.pts for packet in packets if packet.pts is not None]
    if len(transits) < FEWEST_TRANSITS:
        return None
    jitter = 0.0
    for before, after in pairwise(transits):
        jitter += (abs(after - before) - jitter) / JITTER_GAIN
    return jitter / 1e6


@dataclass(frozen=True, slots=True)
class Decoded:
    """What became of some packets.

    Attributes:
        packets: given to the decoder.
        frames: frames that came out.
        damaged: of them, those that are not whole.
        rate: frames a second on this machine as busy as it is; None where that took no time.
        error: of the first packet that did not decode, or "".
        size: width and height of the first frame, px; None where there was none.
    """

    packets: int
    frames: int
    damaged: int
    rate: float | None
    error: str
    size: tuple[int, int] | None


def try_decoding(frames: Sequence[Frame]) -> Decoded:
    """Decodes packets from the first key frame on, for a few seconds at most."""
    first = next((index for index, frame in enumerate(frames) if frame.flags & FrameFlags.KEYFRAME), 0)
    frames = frames[first:]
    if not frames:
        return Decoded(0, 0, 0, None, "", None)
    try:
        decoder: VideoDecoder[Frame] = VideoDecoder(caps_parameters(frames[0].caps))
    except (KeyError, UnknownCodecError) as cause:
        return Decoded(0, 0, 0, None, f"no decoder in this FFmpeg: {cause}", None)
    packets, damaged, error = 0, 0, ""
    sizes: list[tuple[int, int]] = []
    began = time.monotonic()

    def take(decoding: Callable[[], list[tuple[VideoFrame, Frame]]]) -> None:
        nonlocal damaged, error
        try:
            for decoded, _ in decoding():
                damaged += decoded.is_corrupt
                sizes.append((decoded.width, decoded.height))
        except FFmpegError as cause:
            error = error or reason_of(cause)

    for frame in frames:
        if time.monotonic() - began > DECODING_LIMIT_S:
            break
        packets += 1
        take(partial(decoder.decode, frame.data, frame))
    take(decoder.flush)
    elapsed_s = time.monotonic() - began
    rate = len(sizes) / elapsed_s if sizes and elapsed_s else None
    return Decoded(packets, len(sizes), damaged, rate, error, sizes[0] if sizes else None)
