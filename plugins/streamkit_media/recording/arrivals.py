"""Arrival times of a recording's packets, in a JSON-lines file next to it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

SUFFIX = ".arrivals.jsonl"


class BadArrivals(ValueError):
    """A line of the file is invalid."""


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


class ArrivalsWriter:
    """Writes the file line by line, without delay."""

    def __init__(self, recording: Path) -> None:
        self._file = arrivals_path(recording).open("wb", buffering=0)

    def write(self, arrival: Arrival) -> None:
        """Adds a packet."""
        self._file.write(msgspec.json.encode(arrival) + b"\n")

    def close(self) -> None:
        """Completes the file."""
        self._file.close()


def read_arrivals(recording: Path) -> Iterator[Arrival]:
    """The arrivals in the file's order; a last line that was cut short is left out.

    Raises:
        OSError: the file cannot be read.
        BadArrivals: a line before the last is none.
    """
    decoder = msgspec.json.Decoder(Arrival)
    with arrivals_path(recording).open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.endswith(b"\n"):
                return
            try:
                yield decoder.decode(line)
            except (ValueError, TypeError) as error:
                raise BadArrivals(f"line {number} is no arrival: {error}") from None
