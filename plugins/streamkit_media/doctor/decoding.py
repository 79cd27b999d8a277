"""Tries whether what came decodes, and how fast this machine does it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from av.codec.codec import UnknownCodecError
from av.error import FFmpegError

from streamkit import Frame, FrameFlags
from streamkit_media.codecs import caps_parameters
from streamkit_media.container import reason_of
from streamkit_media.decoding.videodecoder import VideoDecoder

LIMIT_S = 5.0


@dataclass(frozen=True, slots=True)
class Decoded:
    """What became of some packets.

    Attributes:
        packets: given to the decoder.
        pictures: frames that came out.
        damaged: of them, those that are not whole.
        rate: frames a second on this machine as busy as it is; None where that took no time.
        error: of the first packet that did not decode, or "".
        size: width and height of the first frame, px; None where there was none.
    """

    packets: int
    pictures: int
    damaged: int
    rate: float | None
    error: str
    size: tuple[int, int] | None


def try_decoding(frames: Sequence[Frame]) -> Decoded:
    """Decodes packets from the first key frame on, for a few seconds at most."""
    keys = (at for at, frame in enumerate(frames) if frame.flags & FrameFlags.KEYFRAME)
    frames = frames[next(keys, 0) :]
    if not frames:
        return Decoded(0, 0, 0, None, "", None)
    try:
        decoder: VideoDecoder[Frame] = VideoDecoder(caps_parameters(frames[0].caps))
    except (KeyError, UnknownCodecError) as cause:
        return Decoded(len(frames), 0, 0, None, f"no decoder in this FFmpeg: {cause}", None)
    pictures: list[tuple[bool, tuple[int, int]]] = []
    packets, error = 0, ""
    began = time.monotonic()
    for frame in (*frames, None):
        if frame is not None and time.monotonic() - began > LIMIT_S:
            continue
        try:
            packets += frame is not None
            found = decoder.flush() if frame is None else decoder.decode(frame.data, frame)
            pictures += [(decoded.is_corrupt, (decoded.width, decoded.height)) for decoded, _ in found]
        except FFmpegError as cause:
            error = error or reason_of(cause)
    elapsed_s = time.monotonic() - began
    return Decoded(
        packets,
        len(pictures),
        sum(is_corrupt for is_corrupt, _ in pictures),
        len(pictures) / elapsed_s if pictures and elapsed_s else None,
        error,
        pictures[0][1] if pictures else None,
    )
