"""Telemetry of either kind to samples, with counts of what was refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from streamkit_telemetry_formats.dji import DjiTelemetry
from streamkit_telemetry_formats.misb import MisbTelemetry
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.subrip import LONGEST_TEXT, subtitle_text

KLV = "meta/x-klv"
REFUSALS = {
    "bad_packets": "{} telemetry packets refused so far: checksum or form is wrong",
    "broken_tags": "{} telemetry values left out so far: not of the length or range of their tag",
    "broken_subtitles": "{} subtitles left out so far: their times or position cannot be read",
}


class TelemetryReader:
    """Reads KLV and subtitles; what it refuses is counted and never raised."""

    def __init__(self) -> None:
        self._misb = MisbTelemetry()
        self._dji = DjiTelemetry()
        self._poses = 0
        self._told = 0
        self._last_pts: int | None = None

    def klv(self, data: bytes, pts: int | None) -> list[Sample]:
        """The samples of the packets that are complete with these bytes; see `MisbTelemetry.feed`."""
        self._last_pts = pts
        return self._counted(self._misb.feed(data, pts))

    def finish(self) -> list[Sample]:
        """What is left of the KLV at the end."""
        return self._counted(self._misb.finish(self._last_pts))

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
        return self.subtitle(subtitle_text(text), pts or 0)

    def subtitle(self, text: str, pts: int) -> list[Sample]:
        """The sample of one subtitle that is shown at a time, ns; none without a valid position."""
        sample = self._dji.sample(text[:LONGEST_TEXT], pts)
        return self._counted([] if sample is None else [sample])

    def subtitles(self, lines: Iterable[str]) -> Iterator[Sample]:
        """The samples of a subtitle file's lines."""
        for sample in self._dji.read(lines):
            self._poses += 1
            yield sample

    def _counted(self, samples: list[Sample]) -> list[Sample]:
        self._poses += len(samples)
        return samples

    def counts(self) -> dict[str, int]:
        """Packets and texts seen, by outcome, for a message."""
        reader = self._misb.reader
        return {
            "poses": self._poses,
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
        """What was refused, in words, when it is first seen and then each time it has doubled; else "".

        Args:
            at_end: say also what has been refused since the last time.
        """
        counts = {name: count for name, count in self.counts().items() if name in REFUSALS and count}
        refused = sum(counts.values())
        if refused == self._told or (refused < 2 * self._told and not at_end):
            return ""
        self._told = refused
        return "; ".join(REFUSALS[name].format(count) for name, count in counts.items())
