"""Packets of one format and epoch: their decoder, and what their frames need of the packets before."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
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
        self._numbers: list[int] = []  # of the packets without a frame yet, ascending
        self._times: list[int] = []  # of the same packets, ascending, ns
        self._failed = 0  # packets among them that gave an error
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
        insort(self._numbers, packet.seq)
        del self._numbers[:-PENDING_LIMIT]
        if packet.pts is not None:
            insort(self._times, packet.pts)
            del self._times[:-PENDING_LIMIT]
        try:
            return self.decoder.decode(packet.data, packet, bool(packet.flags & KEYFRAME), packet.pts)
        except FFmpegError:
            if packet.pts is not None:
                self._failed += 1
            else:
                with suppress(ValueError):
                    self._numbers.remove(packet.seq)
            raise

    def next_number(self, packet: Frame, pts: int | None) -> int:
        """The sequence number of the next frame: frames come out in order of presentation.

        So each takes the first number, behind those of failed packets that would have been shown before it.
        Which packet has failed is not known: threads report it later, when others have been sent.

        Args:
            packet: of the frame; its own number stands in where none is left.
            pts: of the frame, ns.
        """
        if pts is None or not self._numbers:
            return self._numbers.pop(0) if self._numbers else packet.seq
        first, behind = bisect_left(self._times, pts), bisect_right(self._times, pts)
        earlier = min(first, self._failed, len(self._numbers) - 1)
        # A second field, or a part of a packet that is sent again, has the same time.
        same = min(max(0, behind - first - 1), self._failed - earlier)
        number = self._numbers[earlier]
        del self._numbers[: earlier + 1 + same], self._times[:behind]
        self._failed -= earlier + same
        return number

    def is_needed(self, packet: Frame) -> bool:
        """Whether other frames may depend on the one in a packet."""
        if isinstance(packet.data, Packet) and packet.data.is_disposable:
            return False
        return is_reference(codec_of(self.caps), memoryview(packet.data), extradata_of(self.caps))
