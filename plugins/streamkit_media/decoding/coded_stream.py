"""Packets of one format and epoch: their decoder, and what their frames need of the packets before."""

from __future__ import annotations

from bisect import insort
from contextlib import suppress
from typing import TypeAlias

from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame

from streamkit import Frame, FrameFlags
from streamkit_media.codecs import caps_rate, codec_of, extradata_of
from streamkit_media.decoding.framenumbers import FrameNumbers
from streamkit_media.decoding.marks import PENDING_LIMIT
from streamkit_media.decoding.videodecoder import VideoDecoder
from streamkit_media.nalunits import is_reference

KEYFRAME = int(FrameFlags.KEYFRAME)
Decoded: TypeAlias = list[tuple[VideoFrame, Frame]]


class CodedStream:
    """The state of decoding the packets of one format and epoch; the next ones get a new one.

    Attributes:
        caps, epoch: of its packets.
        framerate: by the caps; None if unknown.
        is_flipped: whether frames are to be turned upside down.
        rotation: by which frames are to be rotated counter-clockwise, after that, degrees.
        decoder: as given.
        awaits_keyframe: whether decoding waits for a keyframe, which brings the parameter sets.
        frame_numbers: finds missing frames of H.264; None for other codecs.
        newest_arrival_ns: of the packets so far.
        has_given_frame: whether the decoder has given any.
        next_pts: of a frame whose packet has no time, ns.
        packets: that the decoder has got.
        numbers: sequence numbers of the packets without a frame yet, ascending. Frames come out in order of
            presentation, so each takes the first.
    """

    def __init__(self, first: Frame, decoder: VideoDecoder[Frame]) -> None:
        caps, extradata = first.caps, extradata_of(first.caps)
        self.caps, self.epoch = caps, first.epoch
        self.framerate = caps_rate(caps)
        rotation = caps.get("rotation", 0)
        self.rotation = rotation if isinstance(rotation, int) else 0
        self.is_flipped = caps.get("flipped") is True
        self.decoder = decoder
        self.awaits_keyframe = not extradata
        self.frame_numbers = FrameNumbers(extradata) if codec_of(caps) == "h264" else None
        self.newest_arrival_ns = self.next_pts = 0
        self.numbers: list[int] = []
        self.has_given_frame = False
        self.packets = 0

    def decode(self, packet: Frame) -> Decoded:
        """The frames that a packet completes, in order of presentation, each with its packet.

        Raises:
            FFmpegError: the packet, or one before it, could not be decoded.
        """
        self.packets += 1
        self.awaits_keyframe &= not packet.flags & KEYFRAME
        self.newest_arrival_ns = max(self.newest_arrival_ns, packet.arrival_ns)
        insort(self.numbers, packet.seq)
        del self.numbers[:-PENDING_LIMIT]
        try:
            return self.decoder.decode(packet.data, packet, bool(packet.flags & KEYFRAME), packet.pts)
        except FFmpegError:
            with suppress(ValueError):
                self.numbers.remove(packet.seq)
            raise

    def is_needed(self, packet: Frame) -> bool:
        """Whether other frames may depend on the one in a packet."""
        if isinstance(packet.data, Packet) and packet.data.is_disposable:
            return False
        return is_reference(codec_of(self.caps), memoryview(packet.data), extradata_of(self.caps))
