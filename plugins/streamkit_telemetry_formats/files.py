"""Telemetry in a separate file: DJI subtitles or raw KLV."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import IO

from streamkit_telemetry_formats.klv import SET_KEY
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.telemetryreader import TelemetryReader

CHUNK_BYTES = 1 << 16


class NoTelemetry(ValueError):
    """A file holds no position."""


def holds_klv(path: Path) -> bool:
    """Whether the first 64 KB of a file hold a key of a telemetry set.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return SET_KEY.search(file.read(CHUNK_BYTES)) is not None


class TelemetryFile:
    """The samples of a file, in its order, times from its beginning; read as they are asked for.

    Attributes:
        path: of the file.
        reader: counts what was read and refused since the beginning.

    Raises:
        NoTelemetry: there is not one position in it.
        OSError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: IO[bytes] | None = None
        self.rewind()

    def rewind(self) -> None:
        """Begins again; the same errors as at first."""
        self.close()
        self.reader = TelemetryReader()
        is_klv = holds_klv(self.path)
        self._file = self.path.open("rb")
        samples = self._klv(self._file) if is_klv else self.reader.subtitles(_lines(self._file))
        try:
            first = next(samples, None)
        except BaseException:
            self.close()
            raise
        if first is None:
            self.close()
            raise NoTelemetry(
                f"{self.path}: no position in it; it must hold MISB ST 0601 packets with good checksums, "
                "or DJI subtitles"
            )
        self._samples = chain([first], samples)

    def next(self) -> Sample | None:
        """The next sample; None at the end.

        Raises:
            OSError: reading failed.
        """
        return None if self._file is None else next(self._samples, None)

    def close(self) -> None:
        """Closes the file. Safe to call twice."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def _klv(self, file: IO[bytes]) -> Iterator[Sample]:
        """Packets of a raw file have no time but the platform's clock: the first one's is zero."""
        while data := file.read(CHUNK_BYTES):
            yield from self.reader.klv(data, None)
        yield from self.reader.finish()


def _lines(file: IO[bytes]) -> Iterator[str]:
    while line := file.readline(CHUNK_BYTES):
        yield line.decode("utf-8", "replace")
