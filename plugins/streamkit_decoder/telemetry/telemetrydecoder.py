"""Telemetry of either kind, as it travels in frames, to samples."""

from __future__ import annotations

from typing import Any

from streamkit import Caps
from streamkit_decoder.telemetry import dji
from streamkit_decoder.telemetry.misb import MisbTelemetry
from streamkit_decoder.telemetry.sample import Sample

TELEMETRY_CAPS = "meta/x-klv; text/x-raw"


class TelemetryDecoder:
    """Decodes KLV packets and subtitles; counts what it refuses."""

    def __init__(self) -> None:
        self._misb = MisbTelemetry()
        self._last_pts = 0
        self._texts = 0
        self._samples = 0

    def decode(self, data: Any, pts: int, caps: Caps) -> list[Sample]:
        """The samples that are complete with a frame's data.

        Args:
            data: bytes-like, or text.
            pts: of the frame, ns.
            caps: tell which kind it is.
        """
        self._last_pts = pts
        if caps.name == "meta/x-klv":
            found = self._misb.feed(bytes(data), pts)
        else:
            text = data if isinstance(data, str) else bytes(data).decode("utf-8", "replace")
            sample = dji.sample_of(subtitle_text(text), pts)
            self._texts += 1
            found = [] if sample is None else [sample]
        self._samples += len(found)
        return found

    def finish(self) -> list[Sample]:
        """What is left at the end."""
        found = self._misb.finish(self._last_pts)
        self._samples += len(found)
        return found

    @property
    def bad(self) -> int:
        """Packets refused because of their checksum or form."""
        return self._misb.reader.bad

    def counts(self) -> dict[str, int]:
        """Packets and texts seen, by outcome, for a message."""
        reader = self._misb.reader
        return {
            "poses": self._samples,
            "good_packets": reader.good,
            "bad_packets": reader.bad,
            "skipped_bytes": reader.skipped,
            "subtitles": self._texts,
        }

    def describe(self) -> str:
        """The counts in words."""
        return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in self.counts().items())


def subtitle_text(text: str) -> str:
    """The text of a subtitle packet: the last field of an ASS line, line breaks restored."""
    parts = text.split(",", 8)
    is_ass = len(parts) == 9 and parts[0].strip().isdigit()
    return (parts[8] if is_ass else text).replace("\\N", "\n")
