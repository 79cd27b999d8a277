"""Rates, intervals, jitter and losses of a stream, from its packets."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from av.codec.codec import UnknownCodecError
from av.error import FFmpegError

from streamkit import SECOND_NS, Frame, FrameFlags
from streamkit_media.decoding.videodecoder import VideoDecoder
from streamkit_media.failures import reason_of
from streamkit_media.streams import DecodeOnly

SETTLING_PACKETS = 15  # the first packets come in one go while FFmpeg looks at the stream
MIN_TRANSITS = 15
JITTER_GAIN = 16
DECODING_LIMIT_S = 5.0


@dataclass(frozen=True, slots=True)
class PacketFacts:
    """One packet of the video."""

    pts: int | None  # ns; None if unknown
    arrival_ns: int  # monotonic clock, ns
    size: int  # bytes
    is_keyframe: bool  # whether decoding can begin with it
    is_shown: bool = True  # whether the file shows its frame, and does not hide it by an edit list


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurements of a run of packets; None where it was too short."""

    packets: int  # seen, of frames that are shown
    rate: float | None  # frames per second, by the times of the packets
    bit_rate: float | None  # bit/s
    keyframe_interval_s: float | None  # longest time from keyframe to keyframe
    keyframes: int  # seen, with a time or without
    has_times: bool  # whether packets have times; a bare stream has none
    jitter_ms: float | None  # how unevenly packets arrive, as RFC 3550 counts it
    missing: int  # frames that the times say should be there
    is_variable: bool  # whether the distances of frames vary by more than a tenth


def measure(packets: Sequence[PacketFacts]) -> Measured:
    """Measures a run of packets in the order they came."""
    times = sorted(packet.pts for packet in packets if packet.pts is not None)
    steps = [b - a for a, b in pairwise(times) if b > a]
    middle = statistics.median(steps) if steps else 0
    length_s = (times[-1] - times[0]) / SECOND_NS if steps else 0.0
    keyframe_times = [packet.pts for packet in packets if packet.is_keyframe and packet.pts is not None]
    is_variable = sum(abs(step - middle) > 0.1 * middle for step in steps) > 0.1 * len(steps)
    return Measured(
        packets=sum(packet.is_shown for packet in packets),
        rate=len(steps) / length_s if length_s else None,
        bit_rate=sum(packet.size for packet in packets) * 8 / length_s if length_s else None,
        keyframe_interval_s=max((b - a for a, b in pairwise(keyframe_times)), default=0) / SECOND_NS or None,
        keyframes=sum(packet.is_keyframe for packet in packets),
        has_times=bool(times),
        jitter_ms=_jitter_ms(packets[SETTLING_PACKETS:]),
        missing=0 if is_variable else sum(max(0, round(step / middle) - 1) for step in steps),
        is_variable=is_variable,
    )


def _jitter_ms(packets: Sequence[PacketFacts]) -> float | None:
    """Source: RFC 3550, section 6.4.1 (interarrival jitter)."""
    transits = [packet.arrival_ns - packet.pts for packet in packets if packet.pts is not None]
    if len(transits) < MIN_TRANSITS:
        return None
    jitter = 0.0
    for before, after in pairwise(transits):
        jitter += (abs(after - before) - jitter) / JITTER_GAIN
    return jitter / 1e6


@dataclass(slots=True)
class Decoded:
    """What became of some packets."""

    packets: int = 0  # given to the decoder
    frames: int = 0  # frames that came out
    damaged: int = 0  # of them, those that are not whole
    interlaced: int = 0  # of them, those that may be of two packets, one for each field
    hidden: int = 0  # frames that are decoded for others and not shown, as the file says
    # frames a second on this machine as busy as it is; None where that took no time
    rate: float | None = None
    are_times_wrong: bool = False  # whether those of the packets are in order of coding
    pixel_shape: str = ""  # width to height of a pixel; "" where it is square
    error: str = ""  # of the first packet that did not decode, or ""
    size: tuple[int, int] | None = None  # width and height of the first frame, px; None where there was none


def try_decoding(frames: Sequence[Frame]) -> Decoded:
    """Decodes packets from the first keyframe on, for a few seconds at most."""
    first = next((index for index, frame in enumerate(frames) if frame.flags & FrameFlags.KEYFRAME), 0)
    frames, found = frames[first:], Decoded()
    if not frames:
        return found
    try:
        decoder = VideoDecoder[Frame](frames[0].caps)
    except (KeyError, UnknownCodecError) as cause:
        return Decoded(error=f"no decoder in this FFmpeg: {cause}")
    began = time.monotonic()
    for frame in (*frames, None):
        if frame is not None and time.monotonic() - began > DECODING_LIMIT_S:
            continue
        found.packets += frame is not None
        try:
            if frame is None:
                decoded = decoder.drain()
            else:
                is_keyframe = bool(frame.flags & FrameFlags.KEYFRAME)
                decoded = decoder.decode(frame.data, frame, is_keyframe, frame.pts)
        except FFmpegError as cause:
            found.error = found.error or reason_of(cause)
            continue
        if decoder.drain_errors:
            found.error = found.error or reason_of(decoder.drain_errors[0])
        shown = [image for image, origin in decoded if origin.get(DecodeOnly) is None]
        found.hidden += len(decoded) - len(shown)
        found.frames += len(shown)
        found.damaged += sum(image.is_corrupt for image in shown)
        found.interlaced += sum(image.interlaced_frame for image in shown)
        if decoded and found.size is None:
            found.size = decoded[0][0].width, decoded[0][0].height
    found.pixel_shape, found.are_times_wrong = decoder.pixel_shape, decoder.times.are_wrong
    elapsed_s = time.monotonic() - began
    found.rate = found.frames / elapsed_s if found.frames and elapsed_s else None
    return found
