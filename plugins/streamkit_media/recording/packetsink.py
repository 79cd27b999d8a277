"""packetsink: coded packets to a file, pipe, network or playlist, without encoding."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from typing import Any, BinaryIO, cast

from av.packet import Packet

from streamkit import (
    SECOND_NS,
    Caps,
    Direction,
    Frame,
    FrameFlags,
    NumberedFilesSink,
    OnError,
    PadTemplate,
    Presence,
    Property,
    PropertyError,
    StreamError,
    is_turned_for_display,
    mask_secrets,
)
from streamkit.output.file import OutputFile
from streamkit.output.pipe import STANDARD_OUTPUT
from streamkit_media.codecs import CODED_CAPS, is_same_format
from streamkit_media.nalunits import BadPacket
from streamkit_media.recording.mediaoutput import MediaOutput, shown_location
from streamkit_media.recording.packetwriter import PacketWriter
from streamkit_media.recording.replaysrc import arrival_line, arrivals_path
from streamkit_media.streams import KLV_CAPS, nanoseconds

KLV_NAME = Caps(KLV_CAPS).name
BEFORE_KEYFRAME = "before the first keyframe"
DAMAGED = "damaged packet"
EARLY_LIMIT = 256
SEGMENTS = ("max_size_time", "max_files")
FILES_ALONE = ("max_size_bytes", "max_total_size", "max_age", "arrivals")


class PacketSink(MediaOutput, NumberedFilesSink):
    """Records or sends coded video and KLV telemetry without encoding.

    Frames keep the times of the stream, with which records made beside it are matched. Packets are in the
    file within two seconds, so that a recording plays also when the process was killed. A new segment
    begins with a keyframe once the one before is long or large enough, or when the format changes.
    Telemetry needs a transport stream: .ts, UDP, the standard output, a playlist. A damaged packet is
    left out and counted. A recording is never overwritten unless if-exists=replace; behind a tee, a full
    disk ends the recording and not the pipeline.

    Example:
        filesrc location=flight.mp4 ! packetsink location=copy.ts
    """

    sink = CODED_CAPS
    templates = (PadTemplate("klv", Direction.SINK, Caps(KLV_CAPS), Presence.REQUEST),)
    example = "flight.ts"

    location: str = Property(
        "",
        file="write",
        doc="File; segments need a number or time: flight-%05d.ts, flight-%Y%m%dT%H%M%SZ.ts (UTC). Or - (the "
        "standard output), udp://HOST:PORT, srt://HOST:PORT, or a playlist of segments (HLS), live.m3u8.",
    )
    max_size_time: int = Property(0, min=0, unit="ns", doc="Length of a segment; 0 is no limit.")
    max_size_bytes: int = Property(0, min=0, unit="bytes", doc="Size of a segment; 0 is no limit.")
    arrivals: bool = Property(False, doc="Write the arrival times to a second file, for replaysrc.")
    on_error: OnError = Property(
        OnError.DROP_BRANCH, doc="Behind a tee: whether a failure ends the pipeline or only this branch."
    )

    _writer: PacketWriter | None = None
    _arrivals: BinaryIO | None = None

    def check_properties(self) -> None:
        """Checks the location; only a transport stream holds telemetry, and only files are kept in pieces."""
        super().check_properties()
        refused: tuple[str, ...] = ()
        if self.is_sent or self.location == STANDARD_OUTPUT:
            refused = FILES_ALONE + SEGMENTS
        elif self.is_playlist:
            refused = FILES_ALONE
        if unknown := [name.replace("_", "-") for name in refused if getattr(self, name)]:
            raise PropertyError(
                f"{self.name}: location={mask_secrets(self.location)}: {', '.join(unknown)} must not be set: "
                "it is for files; write for example location=flight-%05d.ts"
            )
        if self.location and "klv" in self.pads and not self.container().is_transport_stream:
            raise PropertyError(
                f"{self.name}: location={self.location}: only .ts holds KLV telemetry; "
                "write a name that ends in .ts"
            )

    def needs_several_files(self) -> bool:
        """Whether there is a limit for a segment that is a file by itself."""
        return not self.is_playlist and bool(self.max_size_time or self.max_size_bytes)

    def start(self) -> None:
        """Checks the name; the file is made when the first keyframe comes."""
        self._writer = self._arrivals = None
        self._caps: Caps | None = None
        self._early: deque[Frame] = deque(maxlen=EARLY_LIMIT)
        self._shift = self._begin = self._keyframe = 0
        self._bytes = self._count = 0
        self._last_dts: int | None = None
        super().start()

    def begin(self) -> None:
        """Files begin with keyframes."""

    def write(self, frame: Frame) -> None:
        """Writes one packet of either kind.

        Raises:
            StreamError: the format changed, and the name has no place for a second file.
        """
        try:
            if frame.caps.name == KLV_NAME:
                self._write_klv(frame)
            else:
                self._write_video(frame)
        except BadPacket as error:
            self._drop_damaged(error)

    def drain(self) -> None:
        """EOS: the file is completed.

        Raises:
            StreamError: damaged packets came, and not one could be written.
        """
        super().drain()
        damaged = self.drops[DAMAGED]
        if damaged and self.has_begun and not self._count:
            raise StreamError(
                f"{self.location}: nothing is written: {damaged} packets are damaged, and no whole keyframe "
                "came; the video is damaged or encrypted"
            )

    def shortfall(self) -> str:
        """A warning if no keyframe came, without which no file begins; `drain` reports damaged ones."""
        return "" if self._count or self.drops[DAMAGED] else "no keyframe came, nothing is written"

    def _write_video(self, frame: Frame) -> None:
        is_keyframe = bool(frame.flags & FrameFlags.KEYFRAME)
        pts, dts = times_of(frame, self._last_dts)
        self._last_dts = dts
        self.check_pace(frame.pts)
        if is_keyframe:
            self._keyframe = pts
        if self._must_change(frame.caps, pts, is_keyframe):
            self._change(frame.caps, pts)
        writer = self._writer
        if writer is None:
            self.count_drop(BEFORE_KEYFRAME)
            return
        is_first = not writer.has_begun
        self._bytes += writer.write_video(
            bytes(frame.data), pts + self._shift, dts + self._shift, frame.duration, is_keyframe
        )
        if is_first:
            self.post_message("segment", location=shown_location(writer.file, self.location), pts=pts)
            while self._early:
                self._write_klv(self._early.popleft())
        if self._arrivals is not None:
            self._arrivals.write(arrival_line(frame))

    def _write_klv(self, frame: Frame) -> None:
        pts = frame.pts or 0
        if self._writer is None:
            # Telemetry of the first frame often comes before it.
            if len(self._early) == self._early.maxlen:
                self.count_drop(BEFORE_KEYFRAME)
            self._early.append(frame)
        elif pts < self._begin:
            self.count_drop(BEFORE_KEYFRAME)
        else:
            self._bytes += self._writer.write_klv(bytes(frame.data), pts + self._shift)

    def _must_change(self, caps: Caps, pts: int, is_keyframe: bool) -> bool:
        """Whether a packet begins a file: the first, one of another format, or a full segment's next."""
        if not is_keyframe:
            since_ns = pts - self._keyframe
            if self._writer is not None and 0 < 2 * self.max_size_time < since_ns:
                self.warn_once(
                    f"a segment of {since_ns / SECOND_NS:.1f} s or more, max-size-time is "
                    f"{self.max_size_time / SECOND_NS:g} s: no keyframe has come at which another can "
                    "begin; set the keyframe interval of the camera or encoder to it, or less",
                    "length",
                )
            return False
        if self._writer is None or self._caps is None:
            return True
        if not is_same_format(caps, self._caps):
            return True
        is_long = self.max_size_time and pts - self._begin >= self.max_size_time
        is_large = self.max_size_bytes and self._bytes >= self.max_size_bytes
        return not self.is_playlist and bool(is_long or is_large)

    def _change(self, caps: Caps, pts: int) -> None:
        """Completes the file under way and begins the next."""
        had_one = self._writer is not None
        self.end()
        if had_one and not self.names.is_several:
            raise StreamError(
                f"{self.location}: one file holds one format, and {caps.name} of another comes now; "
                "give the name a number, flight-%05d.ts"
            )
        file = self.open_output(self.max_size_time, self.retention_limits.max_files)
        try:
            self._writer = PacketWriter(file, self.container(), caps, with_klv="klv" in self.pads)
        except BaseException:
            self.take_back()
            raise
        if is_turned_for_display(caps):  # PyAV writes it with streams that it encodes only
            self.warn_once(
                f"{self.location}: the copy does not say that its frames are to be turned for display: "
                "put decode ! encode before"
            )
        if self.arrivals:
            self._arrivals = cast("BinaryIO", arrivals_path(file.path).open("wb", buffering=0))
        self._shift, self._begin, self._bytes, self._caps = max(0, -pts), pts, 0, caps
        if self._shift:
            self.warn_once(
                f"{self.location}: times are {self._shift / SECOND_NS:.3f} s later than in the stream, which "
                "begins below 0, as a file that was cut without encoding: what the cut hides is shown; put "
                "decode ! encode before to keep the times",
                "shift",
            )

    def _drop_damaged(self, error: BadPacket) -> None:
        """Counts a damaged packet; where it was a file's first, the next keyframe restarts the file."""
        self.count_drop(DAMAGED)
        if self._writer is not None and not self._writer.has_begun:
            self.end()
        self.warn_once(
            f"{self.location}: a packet is left out: {error}; others like it are counted", "damage"
        )

    def end(self) -> None:
        """Completes the file under way; one that nothing could be written to is removed."""
        writer, self._writer = self._writer, None
        arrivals, self._arrivals = self._arrivals, None
        if writer is None:
            return
        try:
            if arrivals is not None:
                arrivals.close()
            writer.close()
        finally:
            if writer.has_begun:
                self._count += 1
            else:
                arrivals_path(writer.file.path).unlink(missing_ok=True)
                self.take_back()
        if writer.has_begun and isinstance(writer.file, OutputFile):
            self.file_is_complete(writer.file.path, arrivals_path(writer.file.path))

    def abandon(self) -> None:
        """Leaves what is written of the last file."""
        with suppress(*self.write_errors):
            self.end()


def times_of(frame: Frame, before: int | None = None) -> tuple[int, int]:
    """Presentation and decoding time, ns: the frame has the first, the packet their distance.

    Args:
        frame: a packet.
        before: decoding time of the packet before it, which stands for an unknown one: FFmpeg does not know
            those of the first packets of Matroska.
    """
    packet: Any = frame.data
    pts = frame.pts or 0
    if not isinstance(packet, Packet) or packet.pts is None:
        return pts, pts
    if packet.dts is None:
        return pts, pts if before is None else min(pts, before)
    return pts, pts - nanoseconds(packet.pts - packet.dts, packet.time_base)
