"""telemetryparse: telemetry to lines of JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from typing_extensions import override

from streamkit import Caps, Frame, Transform
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.telemetryreader import TelemetryReader

OF_FRAMES = ("gap_ns", "is_stale")  # fields of a pose that say how it belongs to a frame


class TelemetryParse(Transform):
    """Decodes KLV (MISB ST 0601, EG 0104) and DJI subtitles to one JSON object for each position.

    Angles are rad, latitudes and longitudes deg, heights m, times ns; what was not sent is left out.

    Example:
        filesrc name=s location=flight.ts  s.klv ! telemetryparse ! filesink location=poses.jsonl
    """

    sink = "meta/x-klv; text/x-raw"
    src = "application/json"

    @override
    def start(self) -> None:
        self._decoder = TelemetryReader()
        self._caps = Caps("application/json")
        self._last: Frame | None = None

    def transform(self, frame: Frame) -> Iterable[Frame]:
        """The samples that are complete with this packet."""
        self._last = frame
        samples = self._decoder.packet(frame.data, frame.caps.name, frame.pts)
        return [self._line(frame, sample) for sample in samples]

    def drain(self) -> Iterable[Frame]:
        """The last samples; posts counts and damage."""
        if self._last is not None:
            yield from [self._line(self._last, sample) for sample in self._decoder.finish()]
        counts = self._decoder.counts()
        self.post_message("telemetry", **counts)
        if complaint := self._decoder.complaint(at_end=True):
            self.post_warning(complaint)
        if self._last is not None and not counts["poses"]:
            self.post_warning(f"no position in the telemetry: {self._decoder.describe()}")

    def _line(self, frame: Frame, sample: Sample) -> Frame:
        return frame.replace(data=json.dumps(as_json(sample)), caps=self._caps, pts=sample.pts)


def as_json(sample: Sample) -> dict[str, Any]:
    """A sample as JSON has it, without what was not sent."""
    found = {
        name: value
        for name, value in asdict(sample).items()
        if value not in (None, ()) and name not in OF_FRAMES
    }
    return {"pts_ns": found.pop("pts"), **found}
