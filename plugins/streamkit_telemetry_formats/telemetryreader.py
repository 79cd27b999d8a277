"""Reads KLV and subtitles from streams and files to samples, and counts what it refuses."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from streamkit_telemetry_formats.dji import DjiTelemetry
from streamkit_telemetry_formats.klv import CHUNK_BYTES, holds_klv
from streamkit_telemetry_formats.misb import MisbTelemetry
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.subrip import MAX_TEXT, subtitle_text

KLV = "meta/x-klv"
REFUSALS = {
    "bad_packets": "{} telemetry packets refused so far: checksum or form is wrong",
    "broken_tags": "{} telemetry values left out so far: not of the length or range of their tag",
    "broken_subtitles": "{} subtitles left out so far: their times or position cannot be read",
}


class TelemetryReader:
    """Reads KLV and subtitles; invalid input is counted, and raises nothing."""

    def __init__(self) -> None:
        self._misb = MisbTelemetry()
        self._dji = DjiTelemetry()
        self._reported = 0
        self._last_pts: int | None = None

    def klv(self, data: bytes, pts: int | None) -> list[Sample]:
        """The samples of the packets that are complete with these bytes; see `MisbTelemetry.feed`."""
        self._last_pts = pts
        return self._misb.feed(data, pts)

    def finish(self) -> list[Sample]:
        """The samples of KLV packets held back, at the end of the stream."""
        return self._misb.finish(self._last_pts)

    def packet(self, data: Any, media_type: str, pts: int | None) -> list[Sample]:
        """The samples that are complete with a packet of a stream.

        Args:
            data: bytes-like, or the text of a subtitle.
            media_type: `meta/x-klv`; any other is a subtitle.
            pts: ns.
        """
        if media_type == KLV:
            return self.klv(bytes(data), pts)
        text = data if isinstance(data, str) else bytes(data).decode("utf-8", "replace")
        sample = self._dji.sample(subtitle_text(text)[:MAX_TEXT], pts or 0)
        return [] if sample is None else [sample]

    def subtitles(self, lines: Iterable[str]) -> Iterator[Sample]:
        """The samples of a subtitle file's lines."""
        return self._dji.read(lines)

    def counts(self) -> dict[str, int]:
        """Packets and texts read, by outcome, for a message."""
        reader = self._misb.reader
        return {
            "poses": self._misb.poses + self._dji.poses,
            "good_packets": reader.good,
            "bad_packets": reader.bad,
            "broken_tags": self._misb.broken_tags,
            "skipped_bytes": reader.skipped,
            "subtitles": self._dji.subtitles,
            "broken_subtitles": self._dji.broken,
        }

    def describe(self) -> str:
        """The counts in words."""
        return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in self.counts().items())

    def complaint(self, at_end: bool = False) -> str:
        """The refusals in words: at the first one and each time their number has doubled; else "".

        With `at_end` also the refusals since the last report.
        """
        counts = {name: count for name, count in self.counts().items() if name in REFUSALS and count}
        refused = sum(counts.values())
        if refused == self._reported or (refused < 2 * self._reported and not at_end):
            return ""
        self._reported = refused
        return "; ".join(REFUSALS[name].format(count) for name, count in counts.items())


class NoTelemetry(ValueError):
    """A file holds no position."""


class TelemetryFile:
    """The samples of a file in its order, with times from its beginning; read on demand.

    Attributes:
        reader: counts what was read and refused since the beginning.

    Raises:
        NoTelemetry: there is not one position in it.
        OSError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._begin()

    def rewind(self) -> None:
        """Restarts at the beginning; raises the same errors as the constructor."""
        self.close()
        self._begin()

    def _begin(self) -> None:
        self.reader = TelemetryReader()
        self._reading = self._read()
        first = next(self._reading, None)
        if first is None:
            raise NoTelemetry(
                f"{self._path}: no position in it; it must hold MISB ST 0601 packets with good checksums, "
                "or DJI subtitles"
            )
        self._samples = chain([first], self._reading)

    def next(self) -> Sample | None:
        """The next sample; None at the end.

        Raises:
            OSError: reading failed.
        """
        return next(self._samples, None)

    def close(self) -> None:
        """Closes the file. Safe to call twice."""
        self._reading.close()

    def _read(self) -> Generator[Sample]:
        """Packets of a raw file have only the platform's clock; that of the first packet is time zero."""
        is_klv = holds_klv(self._path)
        with self._path.open("rb") as file:
            if not is_klv:
                lines = iter(partial(file.readline, CHUNK_BYTES), b"")
                yield from self.reader.subtitles(line.decode("utf-8", "replace") for line in lines)
                return
            while data := file.read(CHUNK_BYTES):
                yield from self.reader.klv(data, None)
        yield from self.reader.finish()
