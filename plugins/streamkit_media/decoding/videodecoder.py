"""Decoder that returns each frame with the packet it came from."""

from __future__ import annotations

import enum
import heapq
from collections import OrderedDict
from typing import Generic, TypeAlias, TypeVar

from av.codec.context import CodecContext, Flags, ThreadType
from av.codec.hwaccel import HWAccel
from av.error import FFmpegError
from av.packet import Packet
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from streamkit_media.codecs import CodecParameters, decoder_for

Origin = TypeVar("Origin")
Data: TypeAlias = "Packet[VideoStream] | bytes | bytearray | memoryview"
# No codec holds more frames back; beyond it, entries of packets that gave no frame are forgotten.
PENDING_LIMIT = 256
MAX_PIXELS = 8192 * 8192
# Frame threads of these can wait for each other without end where damaged frames come out too; where these do
# not, a third of all frames of a damaged stream is lost.
SLICE_THREADS_ONLY = frozenset({"hevc"})


class Threading(enum.StrEnum):
    """How a decoder spreads its work: whole frames (fast, adds a delay) or slices of one frame."""

    FRAME = "frame"
    SLICE = "slice"


class VideoDecoder(Generic[Origin]):
    """Decodes packets of one codec; each frame comes with the origin given with its packet.

    Args:
        parameters: of the codec.
        threading: frame or slice threads; H.265 gets slice threads always.
        threads: how many; 0 is one for each processor.
        device: to decode on; where it cannot, software does.
        holds_for_order: hold back as many H.264 frames as the level allows where the stream does not declare
            its reordering. FFmpeg guesses otherwise, and drops the frames that prove it wrong.

    Attributes:
        threading: what it has.

    Raises:
        UnknownCodecError: this FFmpeg has no decoder for it.
    """

    def __init__(
        self,
        parameters: CodecParameters,
        threading: Threading = Threading.FRAME,
        threads: int = 0,
        device: HWAccel | None = None,
        holds_for_order: bool = False,
    ) -> None:
        context = CodecContext.create(decoder_for(parameters.codec), "r", device)
        assert isinstance(context, VideoCodecContext)
        self.threading = Threading.SLICE if parameters.codec in SLICE_THREADS_ONLY else threading
        self._context = _configured(context, parameters, self.threading, threads)
        if holds_for_order and parameters.codec == "h264":
            self._context.options = {**self._context.options, "strict": "1"}
        self._pending: OrderedDict[int, Origin] = OrderedDict()
        self._count = self._accounted = 0

    @property
    def is_on_device(self) -> bool:
        """Whether the device decodes, and not software in its place."""
        return self._context.is_hwaccel

    @property
    def unaccounted(self) -> int:
        """Packets that gave neither a frame nor an error yet; after `flush` they never will."""
        return self._count - self._accounted

    def decode(
        self,
        data: Data,
        origin: Origin,
        is_keyframe: bool = False,
    ) -> list[tuple[VideoFrame, Origin]]:
        """Gives one packet to the decoder.

        Returns:
            The frames that are complete now, in order of presentation, each with its packet's origin.

        Raises:
            FFmpegError: the packet, or one before it, could not be decoded; the next may.
        """
        packet = _own_packet(data)
        packet.is_keyframe = is_keyframe
        self._count += 1
        # FFmpeg carries a packet's pts to its frame untouched: a number there finds the origin again.
        packet.pts = self._count
        self._pending[self._count] = origin
        if len(self._pending) > PENDING_LIMIT:
            self._pending.popitem(last=False)
        return self._decoded(packet, origin)

    def flush(self) -> list[tuple[VideoFrame, Origin]]:
        """The frames still held; nothing may be decoded after it.

        Raises:
            FFmpegError: a packet could not be decoded; frames of later packets are lost.
        """
        if not self._count:
            return []
        last = next(reversed(self._pending.values()), None)
        return self._decoded(None, last)

    def _decoded(
        self, packet: Packet[Stream] | None, fallback: Origin | None
    ) -> list[tuple[VideoFrame, Origin]]:
        try:
            frames = self._context.decode(packet)
        except FFmpegError:
            self._accounted += 1
            raise
        found = []
        for frame in frames:
            is_pending = frame.pts in self._pending
            self._accounted += is_pending
            origin = self._pending.pop(frame.pts or 0) if is_pending else fallback
            if origin is not None:
                found.append((frame, origin))
        return found


class AscendingNumbers:
    """Gives out numbers that came in decoding order so that they ascend in order of presentation."""

    def __init__(self) -> None:
        self._heap: list[int] = []

    def put(self, number: int) -> None:
        """A packet came in with this number."""
        heapq.heappush(self._heap, number)
        if len(self._heap) > PENDING_LIMIT:
            heapq.heappop(self._heap)

    def discard(self, number: int) -> None:
        """The packet with this number becomes no frame."""
        if number in self._heap:
            self._heap.remove(number)
            heapq.heapify(self._heap)

    def take(self, default: int) -> int:
        """The lowest number not given out, or the default where there is none."""
        return heapq.heappop(self._heap) if self._heap else default


def _configured(
    context: VideoCodecContext, parameters: CodecParameters, threading: Threading, threads: int
) -> VideoCodecContext:
    context.extradata = parameters.extradata or None
    if parameters.width and parameters.height:
        context.width, context.height = parameters.width, parameters.height
    if parameters.tag:
        context.codec_tag = parameters.tag.to_bytes(4, "little").decode("ascii")
    if parameters.bits:
        context.bits_per_coded_sample = parameters.bits
    if parameters.pixel_format:
        context.pix_fmt = parameters.pixel_format
    context.thread_type = ThreadType.FRAME if threading is Threading.FRAME else ThreadType.SLICE
    context.thread_count = threads
    context.options = {"max_pixels": str(MAX_PIXELS)}
    # Damaged frames come out, marked, instead of disappearing.
    context.flags |= Flags.output_corrupt
    return context


def _own_packet(data: Data) -> Packet[Stream]:
    """A copy of a packet, padded as FFmpeg's bit readers want it; the given one may be shared by threads.

    Its memory is FFmpeg's: a frame thread that frees memory of Python's waits for the interpreter's lock, and
    the thread that closes the decoder holds this lock and waits for the frame thread.
    """
    view = memoryview(data)
    packet = Packet(view.nbytes)
    packet.update(view)  # type: ignore[arg-type]
    if isinstance(data, Packet):
        for item in data.iter_sidedata():
            item.to_packet(packet)
    return packet
