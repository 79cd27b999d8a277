"""Arrival times of a recording's packets, in a JSON-lines file next to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from streamkit import Frame, ResourceError

SUFFIX = ".arrivals.jsonl"
ENCODER = msgspec.json.Encoder()


class Arrival(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One packet of the video.

    Attributes:
        seq: its number.
        epoch: its connection.
        pts: ns.
        arrival_ns: monotonic clock of the recording machine.
        capture_ns: UTC; None if unknown.
        capture_origin: rtcp, misb, file or arrival; "" if unknown.
        flags: of the frame.
    """

    seq: int
    epoch: int
    pts: int | None
    arrival_ns: int
    capture_ns: int | None = None
    capture_origin: str = ""
    flags: int = 0


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
