"""Times of presentation for packets whose container stores only those of decoding."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import TypeAlias

from av.error import FFmpegError
from av.packet import Packet
from av.stream import Stream
from av.video.frame import PictureType
from av.video.stream import VideoStream

from streamkit_media.codecs import video_caps
from streamkit_media.decoding.presentation_times import PresentationTimes
from streamkit_media.decoding.videodecoder import VideoDecoder

_Origin: TypeAlias = tuple[int, int | None]  # number of a packet, and its time in the file, ticks
REORDER_LIMIT = 16  # frames; the decoded picture buffer of H.264 and of H.265 holds no more
HELD_LIMIT = 64  # video packets: for the order, and those in the threads of the decoder
TRUSTED_FRAMES = 250  # without a wrong time; encoders that reorder do so within the first keyframe interval


class PresentationOrder:
    """Gives packets times of presentation where the file stores only those of decoding.

    Writers without composition offsets give the packets of a stream with B-frames the times of their
    decoding. A file is suspected where its codec reorders and the times of the first packets ascend in the
    order of coding. Its packets are then decoded here, ahead of their use, since only the decoder knows the
    order for each codec; each packet gets the time that its frame has from `decode`.

    Args:
        video: the stream to mend; None where none is read.

    Attributes:
        has_mended: whether a packet got another time than the file's.
    """

    def __init__(self, video: VideoStream | None) -> None:
        self.has_mended = False
        self._video = video
        self._held: deque[Packet[Stream]] = deque()  # of all streams, in the order of the file
        self._numbers: deque[int] = deque()  # of the video packets among them
        self._known: dict[int, int | None] = {}  # times of presentation, ticks, by number of the packet
        self._times = PresentationTimes()
        self._frames = 0
        self._delay: int | None = None  # from decoding to presentation, ticks; None until it is known

    def mended(self, packets: Iterable[Packet[Stream]]) -> Iterator[Packet[Stream]]:
        """The packets in the order of the file.

        Args:
            packets: of all streams that are read.
        """
        packets = iter(packets)
        first, is_suspicious = self._beginning(packets)
        whole = chain(first, packets)
        return self._reordered(whole, self._video) if self._video and is_suspicious else whole

    def _reordered(self, packets: Iterator[Packet[Stream]], video: VideoStream) -> Iterator[Packet[Stream]]:
        """Decodes packets until their times are trusted; gives each its time."""
        decoder: VideoDecoder[_Origin] = VideoDecoder(video_caps(video), holds_for_order=True)
        for number, packet in enumerate(packets):
            self._held.append(packet)
            if packet.stream_index == video.index:
                self._decode(decoder, number, packet)
            yield from self._released()
            if self._frames > TRUSTED_FRAMES and not self._times.are_wrong:
                break
        self._decode(decoder)
        yield from self._released(is_end=True)
        yield from packets

    def _beginning(self, packets: Iterator[Packet[Stream]]) -> tuple[list[Packet[Stream]], bool]:
        """The packets up to the one that decides, and whether the times are suspicious."""
        video, count, last = self._video, 0, None
        first: list[Packet[Stream]] = []
        if video is None or not video.codec_context.has_b_frames:
            return first, False
        for packet in packets:
            first.append(packet)
            if packet.stream_index != video.index:
                continue
            if packet.pts is None or (last is not None and packet.pts <= last):
                return first, False
            count, last = count + 1, packet.pts
            if count > REORDER_LIMIT:
                break
        return first, count > 1

    def _decode(
        self, decoder: VideoDecoder[_Origin], number: int = 0, packet: Packet[Stream] | None = None
    ) -> None:
        """Decodes a packet, or what the decoder holds, and notes the times of the frames that come out."""
        if packet is not None:
            self._numbers.append(number)
            self._times.add(packet.pts)
        try:
            if packet is None:
                decoded = decoder.drain()
            else:
                decoded = decoder.decode(packet, (number, packet.pts), packet.is_keyframe)
        except FFmpegError:  # `decode` reports it
            if packet is not None:
                self._times.leave_out(packet.pts)
                self._known[number] = packet.pts
            return
        for frame, (origin, pts) in decoded:
            is_bidirectional = frame.pict_type == PictureType.B
            self._known[origin] = self._times.take(
                pts, is_bidirectional=is_bidirectional, is_key=bool(frame.key_frame)
            )
        self._frames += len(decoded)

    def _released(self, *, is_end: bool = False) -> Iterator[Packet[Stream]]:
        """The held packets before the first whose time is not known yet."""
        video = self._video
        is_full = is_end or len(self._numbers) >= HELD_LIMIT
        if self._delay is None and (is_full or self._frames > REORDER_LIMIT):
            self._delay = self._decoding_delay()
        while self._held and self._delay is not None:
            packet = self._held[0]
            if video is not None and packet.stream_index == video.index:
                if self._numbers[0] not in self._known and not is_full:
                    return
                self._mend(packet, self._known.pop(self._numbers.popleft(), packet.pts))
                is_full = is_end or len(self._numbers) >= HELD_LIMIT
            yield self._held.popleft()

    def _decoding_delay(self) -> int:
        """By how much the times of decoding move back, so that no frame is shown before it, ticks."""
        video = [packet for packet in self._held if self._video and packet.stream_index == self._video.index]
        pairs = [(p.dts, self._known.get(n)) for n, p in zip(self._numbers, video, strict=True)]
        return max((dts - pts for dts, pts in pairs if dts is not None and pts is not None), default=0)

    def _mend(self, packet: Packet[Stream], pts: int | None) -> None:
        if not self._times.are_wrong:
            return
        self.has_mended |= pts != packet.pts
        packet.pts = pts
        if packet.dts is not None:
            packet.dts -= self._delay or 0
