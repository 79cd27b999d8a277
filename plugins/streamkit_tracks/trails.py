"""Where targets went over the ground, a line for each: GeoJSON and KML."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import escape

from typing_extensions import override

from streamkit import TrackState
from streamkit_tracks.file_formats import (
    GEOJSON,
    KML,
    FeatureFormat,
    FileKind,
    Record,
    iso_text,
    kml_line,
    located,
    utc_time,
    xml_text,
)

MAX_PLACES = 5000  # of a line, which is written again each second until it ends
MAX_TRAILS = 10_000  # at once; sources that ended leave theirs
LOST = TrackState.LOST.value


@dataclass(slots=True)
class Trail:
    """A target while it stays: its places (longitude, latitude, deg) and their times, ISO 8601 or "".

    Attributes:
        source: of its records.
        number: its id.
        state: the last one with a place.
        seconds: times of the places in the stream, s, where known.
    """

    source: str
    number: int
    state: str = ""
    places: list[tuple[float, float]] = field(default_factory=list)
    times: list[str] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


class TrailFormat(FeatureFormat):
    """Base of both: the line of a target is complete once the target is gone, and provisional before."""

    def __init__(self) -> None:
        self._trails: dict[tuple[str, int], Trail] = {}
        self._is_empty = True

    def line(self, trail: Trail) -> str:
        """The feature of a target."""
        raise NotImplementedError

    @override
    def record(self, record: Record) -> bytes:
        written = super().record(record)
        if self._is_empty and self._trails:
            self._is_empty = False
            return b"\n" + written  # for the sink, which keeps an older file until something is written
        return written

    @override
    def features(self, record: Record) -> Iterator[str]:
        """The lines that are complete: of targets that are gone, and long ones; too many, too."""
        source, time = record["source"], utc_time(record.get("capture_ns"))
        for track in located(record):
            key = source, track["id"]
            trail = self._trails.setdefault(key, Trail(*key))
            trail.state = track["state"]
            trail.places.append((track["geo"]["lon"], track["geo"]["lat"]))
            trail.times.append(iso_text(time) if time else "")
            if "pts_ns" in record:
                trail.seconds.append(record["pts_ns"] / 1e9)
        there = {(source, track["id"]) for track in record["tracks"] if track["state"] != LOST}
        for key, trail in list(self._trails.items()):
            is_over = key[0] == source and (key not in there or len(trail.places) >= MAX_PLACES)
            if is_over or len(self._trails) > MAX_TRAILS:
                yield self.line(trail)
                del self._trails[key]
                if key in there:
                    self._trails[key] = Trail(
                        *key, trail.state, trail.places[-1:], trail.times[-1:], trail.seconds[-1:]
                    )

    @override
    def end(self) -> bytes:
        return self.joined(map(self.line, self._trails.values())) + super().end()


class GeoJsonTrails(TrailFormat):
    """A feature collection (RFC 7946): a line for each target.

    With its times in the stream, `first_s` and `last_s`, and those of capture, if known, as `coordTimes`.
    """

    layout = GEOJSON

    @override
    def line(self, trail: Trail) -> str:
        geometry: dict[str, Any] = {"type": "LineString", "coordinates": trail.places}
        if len(trail.places) == 1:  # no line has one position
            geometry = {"type": "Point", "coordinates": trail.places[0]}
        fields: dict[str, Any] = {"id": trail.number, "source": trail.source, "state": trail.state}
        if trail.seconds:
            fields |= {"first_s": trail.seconds[0], "last_s": trail.seconds[-1]}
        if all(trail.times):
            fields["coordTimes"] = trail.times
        return json.dumps({"type": "Feature", "geometry": geometry, "properties": fields})


class KmlTrails(TrailFormat):
    """KML 2.2: a gx:Track for each target, which viewers play; a line where no time is known."""

    layout = KML

    @override
    def line(self, trail: Trail) -> str:
        source = escape(xml_text(trail.source))
        head = f"<Placemark><name>{trail.number}</name><description>{source} {trail.state}</description>"
        if all(trail.times):
            whens = "".join(f"<when>{time}</when>" for time in trail.times)
            places = "".join(f"<gx:coord>{east:.8f} {north:.8f} 0</gx:coord>" for east, north in trail.places)
            return f"{head}<gx:Track>{whens}\n{places}</gx:Track></Placemark>"
        return f"{head}{kml_line([f'{east:.8f},{north:.8f}' for east, north in trail.places])}</Placemark>"


TRAILS: dict[str, type[TrailFormat]] = {FileKind.GEOJSON: GeoJsonTrails, FileKind.KML: KmlTrails}
