"""decode: coded packets to frames."""

from __future__ import annotations

import enum
import resource
from collections.abc import Iterable, Iterator

from av.codec.codec import UnknownCodecError
from av.codec.context import ThreadType
from av.error import FFmpegError
from av.video.frame import VideoFrame

from streamkit import (
    SECOND_NS,
    Caps,
    DiscontinuityEvent,
    Event,
    Frame,
    FrameFlags,
    Property,
    StreamError,
    Transform,
    display_size,
    raw_video_caps,
)
from streamkit.handoff.library_threads import available_cores
from streamkit_media.codecs import CODED_CAPS, caps_rate, codec_of, size_of
from streamkit_media.decoding.coded_stream import KEYFRAME, CodedStream, Decoded
from streamkit_media.decoding.frame_arrays import FrameReader, OddSize, oriented
from streamkit_media.decoding.marks import Damage, Freshness, InherentDelay
from streamkit_media.decoding.presentation_times import WRONG_TIMES, WRONG_TIMES_CODE
from streamkit_media.decoding.videodecoder import VideoDecoder, accelerator
from streamkit_media.failures import reason_of
from streamkit_media.streams import DecodeOnly

# Plain numbers: the arithmetic of flags is slow, and this runs for every frame.
DISCONTINUITY, CORRUPT = int(FrameFlags.DISCONTINUITY), int(FrameFlags.CORRUPT)
ONE_THREAD_PIXELS = 1920 * 1088
SPARE_THREADS, MAX_THREADS = 2, 16
TOO_OLD = "late: too old when decoded"
NO_KEYFRAME = "no keyframe has come yet"
NO_FRAME = "packet without a frame of its own"
INTERLACED = (
    "the video is interlaced, and what moves has combed edges; deinterlace it for better detections, as "
    "ffmpeg -i IN -vf bwdif OUT does"
)
NOT_SQUARE = (
    "the pixels of the video are not square ({shape}), and angles, sizes and places on the ground are those "
    "of square ones; make them so, as ffmpeg -i IN -vf scale=iw*sar:ih,setsar=1 OUT does"
)
FIRST_FRAME_PACKETS = 100  # more than a decoder holds: 16 for order and 18 for threads, of two fields each
NO_FRAME_YET = (
    "{count} packets of {name} have given no frame: the stream's parameter sets have not come; have the "
    "sender repeat them, as GStreamer's h265parse config-interval=-1 and x265's repeat-headers=1 do"
)


ThreadsType = enum.StrEnum("ThreadsType", "AUTO FRAME SLICE")


class Skip(enum.StrEnum):
    """What a slow machine skips."""

    NONE = "none"
    NON_REFERENCE = "non-reference"
    NON_KEY = "non-key"


class Decode(Transform):
    """Decodes video and images; GRAY8 is the decoder's own luma plane, without copy.

    Damaged frames, and those built on them, are marked as corrupt, counted as the outcome `damaged`, and
    warned of once, at the end. Interlaced video is warned of, and decoded as it is. Times that a container
    stores in order of coding are put in order. An element message `decoder` names the device, or software.

    Example:
        filesrc location=flight.mp4 ! decode ! fakesink
    """

    sink = CODED_CAPS
    src = "video/x-raw, format={ GRAY8, I420, NV12, BGR, RGB }"

    threads: int = Property(
        0, min=0, max=64, doc="Decoder threads; 0 is one for each core, and two more for whole frames."
    )
    threads_type: ThreadsType = Property(
        ThreadsType.AUTO,
        doc="Frame threads are fastest but add a delay; auto takes slice when live or H.265, else frame.",
    )

    skip: Skip = Property(
        Skip.NONE,
        live=True,
        doc="Skip frames that no other depends on, or all but keyframes; they count as dropped.",
    )
    hwaccel: str = Property(
        "auto", doc="Device to decode on: auto, none, or one of FFmpeg's (vaapi, cuda); else software."
    )

    def start(self) -> None:
        """Begins without a decoder; the first packet determines it."""
        self._stream: CodedStream | None = None
        self._reader = FrameReader("GRAY8")
        self._raw_caps: Caps | None = None  # of the last frame
        self._damage = Damage()
        self._gap = 0  # DISCONTINUITY after packets that are not shown, until a frame is
        self._inherent_delay = InherentDelay()
        self._packets = self._frames_decoded = self._frames_shown = 0
        self._errors: list[str] = []  # of packets, each once
        self._reported_device = ""

    # Negotiation.

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """Every raw format, in the size and rate of the packets' caps."""
        if direction == "src" or not caps.is_fixed:
            return super().transform_caps(caps, direction)
        known = ((name, caps.get(name)) for name in ("width", "height", "framerate"))
        fields = {name: value for name, value in known if value is not None}
        if (shown := display_size(caps)) is not None:
            fields["width"], fields["height"] = shown
        is_odd = any(isinstance(size := fields.get(name), int) and size % 2 for name in ("width", "height"))
        formats = "GRAY8, BGR, RGB" if is_odd else "GRAY8, I420, NV12, BGR, RGB"
        return Caps(f"video/x-raw, format={{ {formats} }}").with_fields(**fields)

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """Fixes the format, and the size where the packets' caps have one; else the first frame does."""
        chosen = allowed.fixate(near=sink_caps)
        self._reader = FrameReader(str(chosen["format"]))
        self._raw_caps = None
        if sink_caps.get("width") is None or sink_caps.get("height") is None:
            return None
        size = chosen.integer("width"), chosen.integer("height")
        self._raw_caps = raw_video_caps(self._reader.pixel_format, *size, caps_rate(sink_caps))
        return self._raw_caps

    # Streaming.

    def transform(self, frame: Frame) -> Frame | Iterable[Frame] | None:
        """Decodes one packet; a new format or epoch first drains the old decoder."""
        held: list[Frame] = []
        stream = self._stream
        if stream is None or frame.caps is not stream.caps or frame.epoch != stream.epoch:
            held = list(self._finish())
            stream = self._stream = self._begin(frame)
        data, is_keyframe = memoryview(frame.data), bool(frame.flags & KEYFRAME)
        if not data.nbytes:
            self._drop_packet(frame, "empty packet")
            return held
        if stream.frame_numbers is not None and stream.frame_numbers.lacks_reference(data, is_keyframe):
            frame = frame.replace(flags=frame.flags | CORRUPT)
        if self.skip is not Skip.NONE and self._is_skipped(stream, frame):
            self._drop_packet(frame, f"skip={self.skip}")
            return held
        self._packets += 1
        try:
            decoded = stream.decode(frame)
        except FFmpegError as error:
            reason = NO_KEYFRAME if stream.awaits_keyframe else reason_of(error)
            self._damage.begin(frame.seq, frame.describe())
            self._drop_packet(frame, f"undecodable packet: {reason}")
            self._report_error(reason, f" at {frame.describe()}")
            return held
        stream.has_given_frame |= bool(decoded)
        if stream.packets == FIRST_FRAME_PACKETS and not (stream.has_given_frame or stream.caps.get("width")):
            # No error says why, as where a stream was joined too late.
            self.post_warning(NO_FRAME_YET.format(count=stream.packets, name=stream.caps.name))
        frames = [*held, *self._shown(stream, decoded)]
        return frames[0] if len(frames) == 1 else frames

    def event(self, event: Event) -> None:
        """Sends what the decoder holds before a discontinuity: after it, it is outside the stream."""
        if isinstance(event, DiscontinuityEvent):
            for frame in self._finish():
                self.push_output("src", frame)

    def drain(self) -> Iterable[Frame]:
        """The frames the decoder still holds.

        Raises:
            StreamError: not one packet could be decoded.
        """
        yield from self._finish()
        self._report_damage()
        if self._packets and not self._frames_decoded:
            reason = f": {self._errors[0]}" if self._errors else ""
            # FFmpeg reports frames for which there is no memory as invalid data.
            is_limited = resource.getrlimit(resource.RLIMIT_DATA)[0] != resource.RLIM_INFINITY
            raise StreamError(
                f"none of {self._packets} packets of {self.sink_caps.name} could be decoded{reason}; "
                "the video is damaged, encrypted or cut short"
                + (", or memory-mb= is too low for its frames" if is_limited else "")
            )

    def stop(self) -> None:
        """Frees the decoder; reports damage where EOS did not."""
        self._stream = None
        self._report_damage()

    def _report_damage(self) -> None:
        shown, self._frames_shown = self._frames_shown, 0
        if shown and (damaged := self.outcomes["damaged"]):
            self.post_warning(f"{damaged} of {shown} frames are damaged", "shortfall")
        if shown and (lost := self._damage.lost_end()):
            self.post_warning(lost, "shortfall")

    def _begin(self, frame: Frame) -> CodedStream:
        """Makes the decoder for the stream that begins with a packet."""
        caps = frame.caps
        try:
            codec = codec_of(caps)
            device, name = accelerator(self.hwaccel)
            decoder = VideoDecoder[Frame](
                caps, *self._threads(codec, caps), device, holds_for_order=not self.query_live()
            )
        except (KeyError, UnknownCodecError) as error:
            raise StreamError(f"no decoder in this FFmpeg for {caps}: {error}; convert to H.264") from None
        if device is not None and not decoder.is_on_device:
            name = f"software: {name} does not decode {codec}"
        if name != self._reported_device:
            self._reported_device = name
            self.post_message("decoder", codec=codec, device=name)
        return CodedStream(frame, decoder)

    def _threads(self, codec: str, caps: Caps) -> tuple[ThreadType, int]:
        """What the threads share, and their number: the one set, or what suits the stream.

        Live H.264 of usual size gets one thread: with slice threads FFmpeg does not notice lost slices. Frame
        threads wait for each other and for us: some more than processors keep all of these busy.
        """
        is_auto, is_live = self.threads_type is ThreadsType.AUTO, self.query_live()
        has_slices = is_live if is_auto else self.threads_type is ThreadsType.SLICE
        threading = ThreadType.SLICE if has_slices else ThreadType.FRAME
        if self.threads:
            return threading, self.threads
        if not has_slices:
            return threading, min(MAX_THREADS, available_cores() + SPARE_THREADS)
        width, height = size_of(caps)
        is_usual = is_auto and is_live and codec == "h264" and width * height <= ONE_THREAD_PIXELS
        return threading, 1 if is_usual else available_cores()

    def _drop_packet(self, frame: Frame, reason: str) -> None:
        self._gap |= frame.flags & DISCONTINUITY
        if reason:
            self.count_drop(reason)

    def _is_skipped(self, stream: CodedStream, packet: Frame) -> bool:
        if packet.flags & KEYFRAME:
            return False
        return self.skip is Skip.NON_KEY or not stream.is_needed(packet)

    def _report_error(self, reason: str, where: str = "") -> None:
        """Posts each kind of error of a packet once."""
        if reason not in self._errors:
            self._errors.append(reason)
            self.post_warning(f"a packet could not be decoded{where}: {reason}; continuing with the next")

    def _finish(self) -> Iterator[Frame]:
        """The frames that the decoder still holds; the next packet begins another stream."""
        stream, self._stream = self._stream, None
        if stream is None:
            return
        yield from self._shown(stream, stream.decoder.drain())
        for error in stream.decoder.drain_errors:
            self.count_drop(f"undecodable packet: {reason_of(error)}")
            self._report_error(reason_of(error))
        if stream.decoder.unaccounted:
            self.count_drop(NO_FRAME, stream.decoder.unaccounted)

    def _shown(self, stream: CodedStream, decoded: Decoded) -> list[Frame]:
        self._frames_decoded += len(decoded)
        if stream.decoder.times.are_wrong:
            self.warn_once(WRONG_TIMES, WRONG_TIMES_CODE)
        frames = []
        for video_frame, origin in decoded:
            number = stream.next_number(origin, video_frame.pts)
            is_corrupt = video_frame.is_corrupt or bool(origin.flags & CORRUPT)
            is_key = bool(video_frame.key_frame)
            is_damaged = self._damage.next_frame(origin.seq, is_corrupt=is_corrupt, is_key=is_key)
            reason = self._decide_to_hide(stream, origin) if origin.metadata else None
            if reason is None:
                frames.append(self._frame(stream, video_frame, origin, number, is_damaged))
            else:
                self._drop_packet(origin, reason)
        return frames

    def _decide_to_hide(self, stream: CodedStream, origin: Frame) -> str | None:
        """Adds a frame's age; returns why it is hidden, "" if that is not counted, None if it is shown."""
        hidden, freshness = origin.get(DecodeOnly), origin.get(Freshness)
        # Of the packet that let the decoder give the frame out: a frame that is reordered has not waited.
        age_ns = self.clock_ns() - stream.newest_arrival_ns
        if hidden is not None:
            if freshness is not None:
                self._inherent_delay.add(age_ns)
            return hidden.reason
        if freshness is not None and self._inherent_delay.drops(age_ns, freshness.slack_ns):
            return TOO_OLD
        return None

    def _frame(
        self, stream: CodedStream, video_frame: VideoFrame, origin: Frame, number: int, is_damaged: bool
    ) -> Frame:
        try:
            pixels = self._reader.read(video_frame)
        except OddSize as error:
            raise StreamError(str(error)) from None
        if video_frame.interlaced_frame:
            self.warn_once(INTERLACED)
        if video_frame.key_frame and (shape := stream.decoder.pixel_shape):
            self.warn_once(NOT_SQUARE.format(shape=shape))
        size = video_frame.width, video_frame.height
        if stream.rotation or stream.is_flipped:
            format_ = self._reader.pixel_format
            pixels = oriented(pixels, format_, stream.rotation, is_flipped=stream.is_flipped)
            size = size[::-1] if stream.rotation % 180 else size
        caps = self._raw_caps
        if caps is None or (caps["width"], caps["height"]) != size:
            caps = self._raw_caps = raw_video_caps(self._reader.pixel_format, *size, stream.framerate)
        flags = origin.flags & ~(KEYFRAME | CORRUPT) | self._gap
        self._gap = 0
        flags |= KEYFRAME if video_frame.key_frame else 0
        flags |= CORRUPT if is_damaged else 0
        self._frames_shown += 1
        if is_damaged:
            self.outcomes["damaged"] += 1
        duration = origin.duration
        if duration is None and stream.framerate is not None:
            duration = round(SECOND_NS / stream.framerate)
        pts = stream.next_pts if video_frame.pts is None else video_frame.pts
        stream.next_pts = pts + (duration or 0)
        return origin.replace(data=pixels, caps=caps, pts=pts, duration=duration, flags=flags, seq=number)
