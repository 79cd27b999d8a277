"""Decoder that returns each frame with its time and packet, on the processor or a graphics device."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from av.codec.context import CodecContext, Flags, ThreadType
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.error import FFmpegError
from av.packet import Packet, PacketSideData
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame

from streamkit import Caps
from streamkit_media.codecs import codec_of, decoder_for, extradata_of, size_of
from streamkit_media.container import MAX_PIXELS
from streamkit_media.decoding.marks import PENDING_LIMIT
from streamkit_media.decoding.presentation_times import PresentationTimes

Origin = TypeVar("Origin")
Data: TypeAlias = "Packet[Any] | bytes | bytearray | memoryview"
# Frame threads of these can wait for each other without end where damaged frames come out too; where these do
# not, a third of all frames of a damaged stream is lost.
SLICE_THREADS_ONLY = frozenset({"hevc"})
MPEGTS_STREAM_ID = 19  # AV_PKT_DATA_MPEGTS_STREAM_ID: of one byte, which no decoder reads
SQUARE_TOLERANCE = 0.01  # a pixel of 400:401 is square to any purpose
# In this order; each only where the machine has the device, because asking a driver for one may take seconds.
DEVICES = {
    "cuda": ("/dev", "nvidia[0-9]*"),
    "vaapi": ("/dev/dri", "renderD*"),
    "videotoolbox": ("/System/Library/Frameworks", "VideoToolbox.framework"),
}


class VideoDecoder(Generic[Origin]):
    """Decodes packets of one codec; each frame comes with its presentation time and its packet's origin.

    Args:
        caps: of the packets.
        threading: whole frames (fast, adds a delay) or slices of one; H.265 gets slice threads always.
        threads: how many; 0 is one for each processor.
        device: to decode on; where it cannot, software does.
        holds_for_order: hold back as many H.264 frames as the level allows where the stream does not declare
            its reordering. FFmpeg guesses otherwise, and drops the frames that prove it wrong.

    Attributes:
        threading: what it has.
        times: of the frames; says whether those of the packets are wrong.
        drain_errors: of the packets that could not be decoded in `drain`.
        unaccounted: packets that gave neither a frame nor an error yet; after `drain` they never will.

    Raises:
        KeyError: no codec has these caps.
        UnknownCodecError: this FFmpeg has no decoder for it.
    """

    def __init__(
        self,
        caps: Caps,
        threading: ThreadType = ThreadType.FRAME,
        threads: int = 0,
        device: HWAccel | None = None,
        holds_for_order: bool = False,
    ) -> None:
        codec = codec_of(caps)
        context = CodecContext.create(decoder_for(codec), "r", device)
        assert isinstance(context, VideoCodecContext)
        self._context = context
        self._configure(caps)
        self.threading = context.thread_type = ThreadType.SLICE if codec in SLICE_THREADS_ONLY else threading
        context.thread_count = threads
        is_strict = holds_for_order and codec == "h264"
        context.options = {"max_pixels": str(MAX_PIXELS), **({"strict": "1"} if is_strict else {})}
        # Damaged frames come out, marked, instead of disappearing.
        context.flags |= Flags.output_corrupt
        self.times = PresentationTimes()
        self._pending: OrderedDict[int, tuple[Origin, int | None]] = OrderedDict()
        self._count = self.unaccounted = 0
        self.drain_errors: list[FFmpegError] = []

    def _configure(self, caps: Caps) -> None:
        context, (width, height) = self._context, size_of(caps)
        context.extradata = extradata_of(caps) or None
        if width and height:
            context.width, context.height = width, height
        if tag := caps.get("codec_tag"):
            context.codec_tag = int(str(tag)).to_bytes(4, "little").decode("ascii")
        if bits := caps.get("bits"):
            context.bits_per_coded_sample = int(str(bits))
        if pixel_format := caps.get("pixel_format"):
            context.pix_fmt = str(pixel_format)

    @property
    def pixel_shape(self) -> str:
        """Width to height of a pixel, such as 16:15; "" where it is square, or no frame has come."""
        ratio = self._context.sample_aspect_ratio
        if not ratio or abs(ratio - 1) <= SQUARE_TOLERANCE:
            return ""
        return f"{ratio.numerator}:{ratio.denominator}"

    @property
    def is_on_device(self) -> bool:
        """Whether the device decodes, and not software in its place."""
        return self._context.is_hwaccel

    def decode(
        self, data: Data, origin: Origin, is_keyframe: bool = False, pts: int | None = None
    ) -> list[tuple[VideoFrame, Origin]]:
        """Gives one packet to the decoder.

        Args:
            data: the packet.
            origin: comes out with its frame.
            is_keyframe: whether decoding can begin with it.
            pts: its time, in any unit; None if it has none.

        Returns:
            The frames that are complete now, in order of presentation, each with its packet's origin. The
            `pts` of a frame is that of its packet, corrected where packets have times in order of coding.

        Raises:
            FFmpegError: the packet, or one before it, could not be decoded; the next may.
        """
        # A copy, padded as FFmpeg's bit readers want it: the given one may be shared by threads. Its memory
        # is FFmpeg's: a frame thread that frees memory of Python's waits for the interpreter's lock, and the
        # thread that closes the decoder holds this lock and waits for the frame thread.
        view = memoryview(data)
        packet: Packet[Stream] = Packet(view.nbytes)
        packet.update(view)  # type: ignore[arg-type]
        if isinstance(data, Packet):
            for item in data.iter_sidedata():
                item.to_packet(packet)
        packet.is_keyframe = is_keyframe
        self._count += 1
        self.unaccounted += 1
        # FFmpeg carries a packet's pts to its frame untouched: a number there finds the origin again.
        packet.pts = self._count
        self._pending[self._count] = origin, pts
        self.times.add(pts)
        if len(self._pending) > PENDING_LIMIT:
            self._pending.popitem(last=False)
        try:
            return self._decoded(packet, (origin, pts))
        except FFmpegError:
            self.times.leave_out(pts)
            raise

    def drain(self) -> list[tuple[VideoFrame, Origin]]:
        """The frames still held, around those of `drain_errors`; nothing may be decoded after it."""
        fallback, frames = next(reversed(self._pending.values()), None), []
        for packet in (*self._flushes(), None) if self._count else ():
            try:
                frames += self._decoded(packet, fallback)
            except FFmpegError as error:
                self.drain_errors.append(error)
        return frames

    def _flushes(self) -> Iterator[Packet[Stream]]:
        """Empty packets, each of which lets one frame thread give its frame or error.

        The end of the stream lets all do so at once, and PyAV leaves out what follows an error then: it reads
        no frame but after a packet, and FFmpeg takes none after the end. An empty packet is that end, too,
        unless it has side data. Decoders of other codecs may not expect one.
        """
        is_threaded = self.threading is ThreadType.FRAME and not self.is_on_device
        for _ in range(self._context.thread_count if is_threaded and self._context.name == "h264" else 0):
            packet: Packet[Stream] = Packet()
            PacketSideData(MPEGTS_STREAM_ID, 1).to_packet(packet)  # type: ignore[call-arg]
            yield packet

    def _decoded(
        self, packet: Packet[Stream] | None, fallback: tuple[Origin, int | None] | None
    ) -> list[tuple[VideoFrame, Origin]]:
        try:
            frames = self._context.decode(packet)
        except FFmpegError:
            self.unaccounted -= 1
            raise
        found = []
        for frame in frames:
            is_pending = frame.pts in self._pending
            self.unaccounted -= is_pending
            if (sent := self._pending.pop(frame.pts or 0) if is_pending else fallback) is not None:
                origin, pts = sent
                frame.pts = self.times.take(
                    pts, is_bidirectional=frame.pict_type == PictureType.B, is_key=bool(frame.key_frame)
                )
                found.append((frame, origin))
        return found


def accelerator(wanted: str) -> tuple[HWAccel | None, str]:
    """The accelerator for auto, none or a device of FFmpeg, and its name; None and why for software."""
    if wanted == "none":
        return None, "software"
    present = [name for name, (folder, pattern) in DEVICES.items() if any(Path(folder).glob(pattern))]
    built_in = hwdevices_available()
    for name in present if wanted == "auto" else [wanted]:
        if name not in built_in:
            continue
        try:
            return HWAccel(name, allow_software_fallback=True), name
        except (FFmpegError, ValueError, RuntimeError, OSError):
            continue
    return None, f"software: {'no device' if wanted == 'auto' else f'{wanted} is not available here'}"
