"""packetsink: coded packets to a file, without encoding."""

from __future__ import annotations

import threading
from collections import deque
from pathlib import Path
from typing import Any

from av.packet import Packet

from streamkit import (
    Caps,
    Direction,
    Frame,
    FrameFlags,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
    Sink,
    StreamError,
    write_remedy,
)
from streamkit_media.codecs import CODED_CAPS, caps_parameters
from streamkit_media.container import MEDIA_ERRORS, reason_of
from streamkit_media.location import SegmentNames, local_path
from streamkit_media.nalunits import BadPacket
from streamkit_media.packets import nanoseconds
from streamkit_media.recording.arrivals import Arrival, ArrivalsWriter, arrivals_path
from streamkit_media.recording.packetwriter import FORMATS, WITH_KLV, PacketWriter
from streamkit_media.streams import KLV_CAPS

KLV_NAME = Caps(KLV_CAPS).name
BEFORE_KEYFRAME = "before the first key frame"
DAMAGED = "damaged packet"
CLOSE_LIMIT_S = 5.0
EARLY_LIMIT = 256


class PacketSink(Sink):
    """Records coded video and KLV telemetry without encoding.

    Packets are in the file within two seconds, so that a recording plays also when the process was killed. A
    new segment begins with a key frame once the one before is long or large enough, or when the format
    changes. Telemetry needs .ts. A damaged packet is left out and counted.

    Example:
        filesrc location=flight.mp4 ! packetsink location=copy.ts
    """

    sink = CODED_CAPS
    templates = (PadTemplate("klv", Direction.SINK, Caps(KLV_CAPS), Presence.REQUEST),)

    location: str = Property("", doc="Path, .ts .mp4 .mov or .mkv; segments need a number: flight-%05d.ts.")
    max_size_time: int = Property(0, min=0, unit="ns", doc="Length of a segment; 0 is no limit.")
    max_size_bytes: int = Property(0, min=0, unit="bytes", doc="Size of a segment; 0 is no limit.")
    arrivals: bool = Property(False, doc="Write the arrival times to a second file, for replaysrc.")

    def start(self) -> None:
        """Checks the name; the file is made when the first key frame comes."""
        self._writing = threading.Lock()
        self._writer: PacketWriter | None = None
        self._arrivals: ArrivalsWriter | None = None
        self._caps: Caps | None = None
        self._early: deque[Frame] = deque(maxlen=EARLY_LIMIT)
        self._zero = self._begin = 0
        self._bytes = 0
        self._is_damage_reported = False
        if not self.location:
            raise ResourceError("location= must name the file to write, it is empty; write location=out.ts")
        suffix = Path(self.location).suffix.lower()
        if suffix not in FORMATS:
            raise ResourceError(
                f"{self.location}: the name must end in {', '.join(FORMATS)}, it ends in {suffix!r}"
            )
        if "klv" in self.pads and FORMATS[suffix][0] not in WITH_KLV:
            raise ResourceError(
                f"{self.location}: only .ts holds KLV telemetry; write a name that ends in .ts"
            )
        self._format = FORMATS[suffix]
        self._names = SegmentNames(self.location, bool(self.max_size_time or self.max_size_bytes))
        folder = local_path(self.location).parent
        if not folder.is_dir():
            raise ResourceError(f"{self.location}: the directory {folder} must be there; make it first")

    def render(self, frame: Frame) -> None:
        """Writes one packet of either kind.

        Raises:
            StreamError: the format changed, and the name has no place for a second file.
            ResourceError: writing failed.
        """
        try:
            with self._writing:
                if frame.caps.name == KLV_NAME:
                    self._write_klv(frame)
                else:
                    self._write_video(frame)
        except BadPacket as error:
            self._drop_damaged(error)
        except (*MEDIA_ERRORS, OSError) as error:
            raise self._failure(error) from error

    def drain(self) -> None:
        """EOS: the file is completed.

        Raises:
            StreamError: damaged packets came, and not one could be written.
        """
        self._close()
        if self._names.count:
            return
        if damaged := self.drops[DAMAGED]:
            raise StreamError(
                f"{self.location}: nothing is written: {damaged} packets are damaged, and no whole key frame "
                "came; the video is damaged or encrypted"
            )
        self.post_warning(f"{self.location}: no key frame came, nothing is written")

    def stop(self) -> None:
        """Completes the file where EOS did not."""
        self._close()

    def _write_video(self, frame: Frame) -> None:
        is_keyframe = bool(frame.flags & FrameFlags.KEYFRAME)
        if self._must_change(frame, is_keyframe):
            self._change(frame)
        if self._writer is None:
            self.count_drop(BEFORE_KEYFRAME)
            return
        pts, dts = times_of(frame)
        is_first = not self._writer.has_begun
        self._bytes += self._writer.write_video(
            bytes(frame.data), pts - self._zero, dts - self._zero, frame.duration, is_keyframe
        )
        if is_first:
            self.post_message("segment", location=str(self._writer.path), pts=pts)
            while self._early:
                self._write_klv(self._early.popleft())
        if self._arrivals is not None:
            capture = frame.capture
            self._arrivals.write(
                Arrival(
                    frame.seq, frame.epoch, frame.pts, frame.arrival_ns,
                    capture.utc_ns if capture else None, capture.origin if capture else "", int(frame.flags),
                )
            )  # fmt: skip

    def _write_klv(self, frame: Frame) -> None:
        if self._writer is None:
            # Telemetry of the first frame often comes before it.
            if len(self._early) == self._early.maxlen:
                self.count_drop(BEFORE_KEYFRAME)
            self._early.append(frame)
            return
        if (frame.pts or 0) < self._zero:
            self.count_drop(BEFORE_KEYFRAME)
            return
        self._bytes += self._writer.write_klv(bytes(frame.data), (frame.pts or 0) - self._zero)

    def _must_change(self, frame: Frame, is_keyframe: bool) -> bool:
        """Whether this packet begins a file: the first, one of another format, or a full segment's next."""
        if not is_keyframe:
            return False
        if self._writer is None or not self._same_format(frame.caps):
            return True
        is_long = self.max_size_time and (frame.pts or 0) - self._begin >= self.max_size_time
        return bool(is_long or (self.max_size_bytes and self._bytes >= self.max_size_bytes))

    def _same_format(self, caps: Caps) -> bool:
        if caps is self._caps:
            return True
        assert self._caps is not None
        return caps_parameters(caps) == caps_parameters(self._caps)

    def _change(self, frame: Frame) -> None:
        """Completes the file under way and begins the next."""
        had_one = self._writer is not None
        self._finish()
        if had_one and not self._names.has_number:
            raise StreamError(
                f"{self.location}: one file holds one format, and {frame.caps.name} of another comes now; "
                "give the name a number, flight-%05d.ts"
            )
        path, parameters = self._names.next_path(), caps_parameters(frame.caps)
        try:
            self._writer = PacketWriter(
                path,
                self._format,
                parameters.codec,
                (parameters.width, parameters.height),
                parameters.extradata,
                "klv" in self.pads,
            )
        except BaseException:
            self._names.take_back()
            raise
        if self.arrivals:
            self._arrivals = ArrivalsWriter(path)
        pts, dts = times_of(frame)
        self._zero, self._begin, self._bytes, self._caps = min(dts, pts), pts, 0, frame.caps

    def _drop_damaged(self, error: BadPacket) -> None:
        """Counts a damaged packet; where it was a file's first, the next key frame restarts the file."""
        self.count_drop(DAMAGED)
        with self._writing:
            if self._writer is not None and not self._writer.has_begun:
                self._finish()
        if not self._is_damage_reported:
            self._is_damage_reported = True
            self.post_warning(f"{self.location}: a packet is left out: {error}; others like it are counted")

    def _finish(self) -> None:
        """Closes the file under way; one that nothing could be written to is removed."""
        writer, self._writer = self._writer, None
        arrivals, self._arrivals = self._arrivals, None
        try:
            if arrivals is not None:
                arrivals.close()
            if writer is not None:
                writer.close()
        finally:
            if writer is not None and not writer.has_begun:
                arrivals_path(writer.path).unlink(missing_ok=True)
                self._names.take_back()

    def _close(self) -> None:
        if not self._writing.acquire(timeout=CLOSE_LIMIT_S):
            raise ResourceError(f"{self.location}: the disk has not come back within {CLOSE_LIMIT_S:g} s")
        try:
            self._finish()
        except (*MEDIA_ERRORS, OSError) as error:
            raise self._failure(error) from error
        finally:
            self._writing.release()

    def _failure(self, error: Exception) -> ResourceError:
        return ResourceError(
            f"{self.location}: the recording could not be written: {reason_of(error)}{write_remedy(error)}"
        )


def times_of(frame: Frame) -> tuple[int, int]:
    """Presentation and decoding time, ns: the frame has the first, the packet their distance."""
    packet: Any = frame.data
    pts = frame.pts
    apart = 0
    if isinstance(packet, Packet) and packet.pts is not None and packet.dts is not None:
        apart = nanoseconds(packet.pts - packet.dts, packet.time_base)
    return (pts or 0), (pts or 0) - apart
