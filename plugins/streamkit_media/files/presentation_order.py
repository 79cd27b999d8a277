"""Times of presentation for packets whose container stores only those of decoding."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import chain

from av.error import FFmpegError
from av.packet import Packet
from av.stream import Stream
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from streamkit_media.codecs import video_caps
from streamkit_media.decoding.videodecoder import VideoDecoder

REORDER_LIMIT = 16  # frames; the decoded picture buffer of H.264 and of H.265 holds no more
HELD_LIMIT = 64  # video packets: for the order, and those in the threads of the decoder
TRUSTED_FRAMES = 250  # without a wrong time; encoders that reorder do so within the first keyframe interval


def with_presentation_times(
    packets: Iterator[Packet[Stream]], video: VideoStream | None, report: Callable[[], object]
) -> Iterator[Packet[Stream]]:
    """Gives packets times of presentation where the file stores only those of decoding.

    Writers without composition offsets give the packets of a stream with B-frames the times of their
    decoding. A file is suspected where its codec reorders and the times of the first packets ascend in the
    order of coding. Its packets are then decoded here, ahead of their use, since only the decoder knows the
    order for each codec; each packet gets the time that its frame has from `decode`.

    Args:
        packets: of all streams that are read, in the order of the file.
        video: the stream whose times are corrected; None where none is read.
        report: called for each packet that gets another time than the file's.
    """
    if video is None or not video.codec_context.has_b_frames:
        return packets
    first, is_suspected = _read_beginning(packets, video.index)
    whole = chain(first, packets)
    return _TimeCorrection(video, report).corrected(whole) if is_suspected else whole


def _read_beginning(packets: Iterable[Packet[Stream]], index: int) -> tuple[list[Packet[Stream]], bool]:
    """The packets up to the one that decides, and whether the times of the video are suspected."""
    first: list[Packet[Stream]] = []
    count, last = 0, None
    for packet in packets:
        first.append(packet)
        if packet.stream_index != index:
            continue
        if packet.pts is None or (last is not None and packet.pts <= last):
            return first, False
        count, last = count + 1, packet.pts
        if count > REORDER_LIMIT:
            break
    return first, count > 1


class _TimeCorrection:
    """Decodes the video of a file ahead of its use; arguments as those of `with_presentation_times`."""

    def __init__(self, video: VideoStream, report: Callable[[], object]) -> None:
        self._index, self._report = video.index, report
        self._decoder = VideoDecoder[int](video_caps(video), holds_for_order=True)
        self._held: deque[tuple[int, Packet[Stream]]] = deque()  # of all streams, with their numbers
        self._held_video = 0  # number of video packets among them
        self._known: dict[int, int | None] = {}  # times of presentation, ticks, by number of the packet
        self._frames = 0
        self._delay: int | None = None  # from decoding to presentation, ticks; None until it is known

    def corrected(self, packets: Iterator[Packet[Stream]]) -> Iterator[Packet[Stream]]:
        """Decodes packets until their times are trusted; gives each its time."""
        for number, packet in enumerate(packets):
            self._held.append((number, packet))
            if packet.stream_index == self._index:
                self._decode(number, packet)
            yield from self._released()
            if self._frames > TRUSTED_FRAMES and not self._decoder.times.are_wrong:
                break
        self._note(self._decoder.drain())
        yield from self._released(is_end=True)
        yield from packets

    def _decode(self, number: int, packet: Packet[Stream]) -> None:
        self._held_video += 1
        try:
            self._note(self._decoder.decode(packet, number, packet.is_keyframe, packet.pts))
        except FFmpegError:  # `decode` reports it
            self._known[number] = packet.pts

    def _note(self, decoded: list[tuple[VideoFrame, int]]) -> None:
        self._known.update((number, frame.pts) for frame, number in decoded)
        self._frames += len(decoded)

    def _released(self, *, is_end: bool = False) -> Iterator[Packet[Stream]]:
        """The held packets before the first whose time is not known yet."""
        if self._delay is None and (is_end or self._is_full() or self._frames > REORDER_LIMIT):
            self._delay = self._decoding_delay()
        while self._held and self._delay is not None:
            number, packet = self._held[0]
            if packet.stream_index == self._index:
                if not (number in self._known or is_end or self._is_full()):
                    return
                self._correct(packet, self._known.pop(number, packet.pts), self._delay)
                self._held_video -= 1
            self._held.popleft()
            yield packet

    def _is_full(self) -> bool:
        return self._held_video >= HELD_LIMIT

    def _decoding_delay(self) -> int:
        """How much earlier decoding times must be, so that no frame is decoded after it is shown, ticks."""
        pairs = ((packet.dts, self._known.get(number)) for number, packet in self._held)
        return max((dts - pts for dts, pts in pairs if dts is not None and pts is not None), default=0)

    def _correct(self, packet: Packet[Stream], pts: int | None, delay: int) -> None:
        if not self._decoder.times.are_wrong:
            return
        if pts != packet.pts:
            self._report()
        packet.pts = pts
        if packet.dts is not None:
            packet.dts -= delay
