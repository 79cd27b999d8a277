"""File formats for track records: MOT Challenge text, CSV, GeoJSON and KML, written record by record."""

from __future__ import annotations

import csv
import enum
import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, ClassVar, NamedTuple
from xml.sax.saxutils import escape

from typing_extensions import override

from streamkit import SHOWN_STATES
from streamkit.output.names import TRACK_SUFFIXES
from streamkit.output.text import TextFormat

Record = Mapping[str, Any]

CSV_COLUMNS = (
    "source", "seq", "epoch", "pts_ns", "capture_ns", "id", "state", "x", "y", "length", "width", "angle",
    "x0", "y0", "x1", "y1", "vx", "vy", "score", "age_ns", "lat", "lon", "error_m",
)  # fmt: skip
NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MOT_CORNER = 1.5  # a box starts half a pixel before the centre of its first pixel, and pixels count from 1


FileKind = enum.StrEnum("FileKind", "AUTO JSONL MOT CSV GEOJSON KML COT")


# In the order of the kinds.
KINDS = dict(zip(TRACK_SUFFIXES, tuple(FileKind)[1:], strict=True))


class RecordFormat(TextFormat):
    """Base of the formats, and that of JSON lines, which are written as they are published."""

    def record(self, record: Record) -> bytes:
        """The bytes of a record."""
        raise NotImplementedError


class MotFormat(RecordFormat):
    """MOT Challenge: frame, id, left, top, width, height, score, -1, -1, -1; frames and pixels count from 1.

    Confirmed and coasting targets, with the axis-aligned box around the rotated one.

    Source: Milan et al., MOT16: A Benchmark for Multi-Object Tracking, arXiv 1603.00831, table 4.
    """

    @override
    def record(self, record: Record) -> bytes:
        lines = []
        for track in _shown(record):
            left, top, right, bottom = track["bbox"]
            first = (left + MOT_CORNER, top + MOT_CORNER)
            numbers = [*first, right - left, bottom - top, track["score"]]
            written = ",".join(f"{number:.3f}".rstrip("0").rstrip(".") for number in numbers)
            lines.append(f"{record['seq'] + 1},{track['id']},{written},-1,-1,-1\n")
        return "".join(lines).encode()


class CsvFormat(RecordFormat):
    """A row per target, tentative ones included; unknown values are empty."""

    @override
    def begin(self) -> bytes:
        return _csv([CSV_COLUMNS])

    @override
    def record(self, record: Record) -> bytes:
        rows = []
        for track in record["tracks"]:
            boxed = dict(zip(("x0", "y0", "x1", "y1"), track["bbox"], strict=True))
            # The target comes last: its width replaces the frame's.
            fields = {**record, **track.get("geo", {}), **boxed, **track}
            rows.append([fields.get(name, "") for name in CSV_COLUMNS])
        return _csv(rows)


class Layout(NamedTuple):
    """What stands before, between and after the features of a file."""

    head: str
    between: str
    tail: str


GEOJSON = Layout('{"type": "FeatureCollection", "features": [', ",", "\n]}\n")
KML = Layout(
    '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
    'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>',
    "",
    "\n</Document></kml>\n",
)


class FeatureFormat(RecordFormat):
    """Base of GeoJSON and KML: features in a layout, each on a line of its own."""

    has_end = True
    layout: ClassVar[Layout]
    _has_features = False

    def features(self, record: Record) -> Iterator[str]:
        """The features that are complete with a record."""
        raise NotImplementedError

    @override
    def begin(self) -> bytes:
        return self.layout.head.encode()

    @override
    def record(self, record: Record) -> bytes:
        written = self.joined(self.features(record))
        self._has_features |= bool(written)
        return written

    def joined(self, features: Iterable[str]) -> bytes:
        """Features as they follow those that are written."""
        text = f"{self.layout.between}\n".join(features)
        before = self.layout.between if self._has_features else ""
        return f"{before}\n{text}".encode() if text else b""

    @override
    def end(self) -> bytes:
        return self.layout.tail.encode()


class GeoJsonFormat(FeatureFormat):
    """A feature collection (RFC 7946): a point for each target and time with ground coordinates."""

    layout = GEOJSON

    @override
    def features(self, record: Record) -> Iterator[str]:
        for track in located(record):
            position = track["geo"]
            fields = {name: track[name] for name in ("id", "state", "score", "age_ns")}
            fields |= {"source": record["source"], "seq": record["seq"]}
            if "pts_ns" in record:
                fields["pts_ns"] = record["pts_ns"]
            if (time := utc_time(record.get("capture_ns"))) is not None:
                fields["time"] = iso_text(time)
            if "error_m" in position:
                fields["error_m"] = position["error_m"]
            point = {"type": "Point", "coordinates": [position["lon"], position["lat"]]}
            yield json.dumps({"type": "Feature", "geometry": point, "properties": fields})


class KmlFormat(FeatureFormat):
    """KML 2.2: a placemark with a time stamp for each target and time with ground coordinates."""

    layout = KML

    @override
    def features(self, record: Record) -> Iterator[str]:
        time = utc_time(record.get("capture_ns"))
        when = f"<TimeStamp><when>{iso_text(time)}</when></TimeStamp>" if time else ""
        source = escape(xml_text(record["source"]))
        for track in located(record):
            place = f"{track['geo']['lon']:.8f},{track['geo']['lat']:.8f}"
            yield (
                f"<Placemark><name>{track['id']}</name><description>{source} {track['state']}</description>"
                f"{when}{kml_line([place])}</Placemark>"
            )


FORMATS: dict[str, type[RecordFormat]] = {
    FileKind.JSONL: RecordFormat,
    FileKind.MOT: MotFormat,
    FileKind.CSV: CsvFormat,
    FileKind.GEOJSON: GeoJsonFormat,
    FileKind.KML: KmlFormat,
}
# These leave out targets without ground coordinates.
GEOGRAPHIC = frozenset((FileKind.GEOJSON, FileKind.KML, FileKind.COT))


def utc_time(time_ns: int | None) -> datetime | None:
    """A UTC time in ns to the nearest millisecond; None where it is unknown, or in no calendar."""
    try:
        return None if time_ns is None else EPOCH + timedelta(milliseconds=(time_ns + 500_000) // 1_000_000)
    except OverflowError:
        return None


def iso_text(time: datetime) -> str:
    """A UTC time in ISO 8601, to the millisecond."""
    return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def kml_line(places: Sequence[str], options: str = "") -> str:
    """A KML line through places, after its options; a point where there is one place, which is no line."""
    kind = "LineString" if len(places) > 1 else "Point"
    return f"<{kind}>{options}<coordinates>{' '.join(places)}</coordinates></{kind}>"


def xml_text(text: str) -> str:
    """The text with each character that XML 1.0 does not allow, escaped or not, replaced by `?`."""
    return NOT_IN_XML.sub("?", text)


def _shown(record: Record) -> Iterator[Mapping[str, Any]]:
    return (track for track in record["tracks"] if track["state"] in SHOWN_STATES)


def located(record: Record) -> Iterator[Mapping[str, Any]]:
    """The confirmed and coasting targets with ground coordinates."""
    return (track for track in _shown(record) if "geo" in track)


def _csv(rows: Iterable[Iterable[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
