"""The streams of a container (video, KLV telemetry, subtitles, audio), their caps, and packets as frames."""

from __future__ import annotations

import enum
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from fractions import Fraction

from av.audio.stream import AudioStream
from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import SECOND_NS, Caps, Frame, FrameFlags, StreamError, Structure
from streamkit_media.codecs import video_caps
from streamkit_media.failures import MEDIA_ERRORS, reason_of

KLV_CAPS = "meta/x-klv, parsed=(boolean)false"
SUBTITLE_CAPS = "text/x-raw, format=utf8"
AUDIO_CAPS = "audio/x-coded"
BARE_PACKETS = "data"  # FFmpeg's format for a file that has no container
UNNAMED_IN = frozenset({"rtsp", BARE_PACKETS})
PLAIN_SUBTITLES = frozenset({"mov_text", "subrip", "text", "srt", "webvtt", "ass"})
KEYFRAME, CORRUPT = int(FrameFlags.KEYFRAME), int(FrameFlags.CORRUPT)


class StreamKind(enum.StrEnum):
    """What a stream carries; the name of the pad it comes out of."""

    VIDEO = "video"
    KLV = "klv"
    SECOND_KLV = "klv_1"
    SUBTITLE = "subtitle"
    AUDIO = "audio"


def streams_of(container: InputContainer, kinds: Collection[StreamKind]) -> list[tuple[Stream, StreamKind]]:
    """The stream of each kind wanted, in the order of kinds; those not there are left out."""
    return [
        (stream, kind)
        for kind in StreamKind
        if kind in kinds and (stream := _stream_of(container, kind)) is not None
    ]


def kinds_of(container: InputContainer) -> frozenset[StreamKind]:
    """The kinds of streams that a container holds."""
    return frozenset(kind for kind in StreamKind if _stream_of(container, kind) is not None)


def _stream_of(container: InputContainer, kind: StreamKind) -> Stream | None:
    """The stream that goes out of a kind's pad.

    Of video and audio FFmpeg's best, of the others the first; `klv_1` is the second KLV stream.
    """
    if kind is StreamKind.VIDEO:
        return container.streams.best("video")
    if kind is StreamKind.AUDIO:
        found = container.streams.best("audio")
        return found if isinstance(found, AudioStream) and found.codec_context is not None else None
    wanted = "subtitle" if kind is StreamKind.SUBTITLE else "data"
    carrying = [stream for stream in container.streams if _carries(stream, wanted)]
    index = 1 if kind is StreamKind.SECOND_KLV else 0
    return carrying[index] if len(carrying) > index else None


def _carries(stream: Stream, wanted: str) -> bool:
    if stream.type != wanted:
        return False
    if wanted == "subtitle":  # one whose codec FFmpeg does not know has no context, and no name
        return stream.codec_context is not None and stream.name in PLAIN_SUBTITLES
    # FFmpeg names it neither over RTSP (RFC 6597) nor in a file of bare packets; other data has no KLV keys.
    return stream.name == "klv" or (stream.name is None and stream.container.format.name in UNNAMED_IN)


def stream_caps(stream: Stream, kind: StreamKind) -> Caps:
    """The fixed caps of a stream's packets."""
    if isinstance(stream, VideoStream):
        return video_caps(stream)
    if not isinstance(stream, AudioStream):
        return Caps(SUBTITLE_CAPS if kind is StreamKind.SUBTITLE else KLV_CAPS)
    context = stream.codec_context
    fields: dict[str, int | str] = {
        "codec": context.codec.canonical_name,
        "rate": stream.sample_rate or 0,
        "channels": stream.channels or 0,
    }
    if context.extradata:
        fields["codec_data"] = context.extradata.hex()
    return Caps((Structure(AUDIO_CAPS, fields),))


@dataclass(frozen=True)
class DecodeOnly:
    """Metadata of a packet whose frame is decoded for others and not shown."""

    reason: str = ""  # for which its frame counts as dropped; "" where it is not counted


DECODE_ONLY = DecodeOnly()


def nanoseconds(ticks: int, time_base: Fraction) -> int:
    """Ticks of a time base in ns, rounded once: the error is below half a nanosecond at any time."""
    numerator, denominator = ticks * time_base.numerator * SECOND_NS, time_base.denominator
    return (2 * numerator + denominator) // (2 * denominator)


def ticks(ns: int, time_base: Fraction) -> int:
    """A time in ns in units of a time base, rounded."""
    return round(Fraction(ns, SECOND_NS) / time_base)


def packet_frame(packet: Packet[Stream], caps: Caps) -> Frame:
    """A packet as a frame; its bytes are shared, not copied."""
    base = packet.time_base
    flags = KEYFRAME if packet.is_keyframe else 0
    if packet.is_corrupt:
        flags |= CORRUPT
    frame = Frame(
        packet,
        caps,
        pts=None if packet.pts is None else nanoseconds(packet.pts, base),
        duration=nanoseconds(packet.duration, base) if packet.duration else None,
        flags=flags,
    )
    return frame.attach(DECODE_ONLY) if packet.is_discard else frame


def read_packets(container: InputContainer, *streams: Stream) -> Iterator[Packet[Stream]]:
    """The streams' packets that hold data, in the order of the file.

    Raises:
        StreamError: reading failed; packets before were good.
    """
    try:
        for packet in container.demux(*streams):
            if packet.size:
                yield packet
    except MEDIA_ERRORS as error:
        raise StreamError(f"reading failed: {reason_of(error)}") from None
