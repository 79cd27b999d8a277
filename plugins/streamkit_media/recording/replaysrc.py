"""replaysrc: plays a recording with its arrival times, which stand in a JSON-lines file next to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import msgspec

from streamkit import Caps, Capture, Frame, Property, ResourceError, Source
from streamkit.output.names import local_path
from streamkit_media.codecs import CODED_CAPS, video_caps
from streamkit_media.container import check_file, open_container, video_stream
from streamkit_media.streams import packet_frame, read_packets

ORIGINS = ("rtcp", "misb", "file", "arrival")
SUFFIX = ".arrivals.jsonl"
ENCODER = msgspec.json.Encoder()


class ReplaySrc(Source):
    """Plays what `packetsink arrivals=true` recorded with its numbers, epochs, times and pauses.

    Example:
        replaysrc location=flight.ts ! decode ! fakesink
    """

    src = CODED_CAPS
    is_live = True

    location: str = Property(
        "", file="read", doc="Path of the recording; the file of arrivals is next to it."
    )
    speed: float = Property(
        1.0, min=0.0, max=1000.0, doc="1 is the original speed, 2 twice as fast, 0 without waiting."
    )

    def start(self) -> None:
        """Checks that the recording and its arrivals are there."""
        if not self.location:
            raise ResourceError("location= must name a recording, it is empty; write location=flight.ts")
        check_file(self.location)
        if not arrivals_path(local_path(self.location)).is_file():
            raise ResourceError(
                f"{self.location}: it has no file of arrivals; record with packetsink arrivals=true, "
                "or play it with filesrc"
            )
        with open_container(self.location) as container:
            self._caps = video_caps(video_stream(container, self.location))

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps of the recording."""
        return self._caps

    def frames(self) -> Iterator[Frame]:
        """The packets, each when its time has come.

        Raises:
            ResourceError: the arrivals are damaged.
        """
        arrivals = read_arrivals(local_path(self.location))
        with open_container(self.location) as container:
            stream = video_stream(container, self.location)
            began, first = self.clock_ns(), None
            for packet, arrival in zip(read_packets(container, stream), arrivals, strict=False):
                first = arrival.arrival_ns if first is None else first
                elapsed_ns = arrival.arrival_ns - first
                due = began + (round(elapsed_ns / self.speed) if self.speed else 0)
                if not self.clock.wait_until(due, self.over):
                    return
                yield self._frame(packet_frame(packet, self._caps), arrival, due)

    def _frame(self, frame: Frame, arrival: Arrival, due: int) -> Frame:
        capture = None
        if arrival.capture_ns is not None and arrival.capture_origin in ORIGINS:
            capture = Capture(arrival.capture_ns, cast("Any", arrival.capture_origin))
        return frame.replace(
            seq=arrival.seq, epoch=arrival.epoch, pts=arrival.pts, arrival_ns=due, capture=capture,
            flags=arrival.flags,
        )  # fmt: skip


class Arrival(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One packet of the video."""

    seq: int  # its number
    epoch: int  # its connection
    pts: int | None  # ns
    arrival_ns: int  # monotonic clock of the recording machine
    capture_ns: int | None = None  # UTC; None if unknown
    capture_origin: str = ""  # rtcp, misb, file or arrival; "" if unknown
    flags: int = 0  # of the frame


def arrivals_path(recording: Path) -> Path:
    """The path of a recording's arrival times."""
    return recording.with_name(recording.name + SUFFIX)


def arrival_line(frame: Frame) -> bytes:
    """The line for a packet."""
    utc_ns, origin = (frame.capture.utc_ns, frame.capture.origin) if frame.capture else (None, "")
    return ENCODER.encode_lines(
        [Arrival(frame.seq, frame.epoch, frame.pts, frame.arrival_ns, utc_ns, origin, int(frame.flags))]
    )


def read_arrivals(recording: Path) -> Iterator[Arrival]:
    """The arrivals in the file's order; a last line that was cut short is left out.

    Raises:
        OSError: the file cannot be read.
        ResourceError: a line before the last is none.
    """
    decoder = msgspec.json.Decoder(Arrival)
    with arrivals_path(recording).open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.endswith(b"\n"):
                return
            try:
                yield decoder.decode(line)
            except (ValueError, TypeError) as error:
                raise ResourceError(f"{recording}: line {number} is no arrival: {error}") from None
