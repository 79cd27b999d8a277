"""Telemetry of either kind, as it travels in frames, to samples."""

from __future__ import annotations

from streamkit import Frame
from streamkit_decoder.telemetry.sample import Sample
from streamkit_decoder.telemetry.telemetryreader import TelemetryReader

TELEMETRY_CAPS = "meta/x-klv; text/x-raw"


class TelemetryDecoder(TelemetryReader):
    """Decodes KLV packets and subtitles; counts what it refuses."""

    def __init__(self) -> None:
        super().__init__()
        self._last_pts: int | None = None

    def decode(self, frame: Frame) -> list[Sample]:
        """The samples that are complete with a frame's data; its caps tell which kind it is."""
        self._last_pts = frame.pts
        data = frame.data
        if frame.caps.name == "meta/x-klv":
            return self.klv(bytes(data), frame.pts)
        text = data if isinstance(data, str) else bytes(data).decode("utf-8", "replace")
        return self.subtitle(subtitle_text(text), frame.pts or 0)

    def finish(self) -> list[Sample]:
        """What is left at the end."""
        return self.klv_end(self._last_pts)


def subtitle_text(text: str) -> str:
    """The text of a subtitle packet: the last field of an ASS line, line breaks restored."""
    parts = text.split(",", 8)
    is_ass = len(parts) == 9 and parts[0].strip().isdigit()
    return (parts[8] if is_ass else text).replace("\\N", "\n")
