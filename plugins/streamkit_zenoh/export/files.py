"""Files of track records: JSON lines, MOT Challenge text, CSV, GeoJSON and KML, written as records come."""

from __future__ import annotations

import csv
import enum
import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any
from xml.sax.saxutils import escape

Record = Mapping[str, Any]

CSV_COLUMNS = (
    "source", "seq", "epoch", "pts_ns", "capture_ns", "id", "state", "x", "y", "length", "width", "angle",
    "x0", "y0", "x1", "y1", "vx", "vy", "score", "age_ns", "lat", "lon",
)  # fmt: skip
NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
SHOWN = ("confirmed", "coasting")
MOT_CORNER = 1.5  # a box begins half a pixel before the centre of its first pixel, which is number 1


class FileKind(enum.StrEnum):
    """What a file of records looks like."""

    AUTO = "auto"
    JSONL = "jsonl"
    MOT = "mot"
    CSV = "csv"
    GEOJSON = "geojson"
    KML = "kml"


SUFFIXES = {
    ".txt": FileKind.MOT,
    ".csv": FileKind.CSV,
    ".geojson": FileKind.GEOJSON,
    ".kml": FileKind.KML,
}


class RecordFile:
    """What is written before the first record, for each one, and behind the last; base of the kinds."""

    def begin(self) -> bytes:
        """What comes first."""
        return b""

    def record(self, record: Record) -> bytes:
        """What is written for a record."""
        raise NotImplementedError

    def end(self) -> bytes:
        """What comes last."""
        return b""


class MotFile(RecordFile):
    """MOT Challenge: frame, id, left, top, width, height, score, -1, -1, -1; frames and pixels count from 1.

    Confirmed and coasting targets, with the upright box around the turned one.

    Source: Milan et al., MOT16: A Benchmark for Multi-Object Tracking, arXiv 1603.00831, table 4.
    """

    def record(self, record: Record) -> bytes:
        """A line a target."""
        lines = []
        for track in _shown(record):
            left, top, right, bottom = track["bbox"]
            first = (left + MOT_CORNER, top + MOT_CORNER)
            numbers = [*first, right - left, bottom - top, track["score"]]
            written = ",".join(f"{number:.3f}".rstrip("0").rstrip(".") for number in numbers)
            lines.append(f"{record['seq'] + 1},{track['id']},{written},-1,-1,-1\n")
        return "".join(lines).encode()


class CsvFile(RecordFile):
    """A row a target, with all its numbers; what is not known is empty."""

    def begin(self) -> bytes:
        """The names of the columns."""
        return _csv([CSV_COLUMNS])

    def record(self, record: Record) -> bytes:
        """A row a target, tentative ones included."""
        rows = []
        for track in record["tracks"]:
            boxed = dict(zip(("x0", "y0", "x1", "y1"), track["bbox"], strict=True))
            # The target's own width comes last: the record's is that of the frame.
            facts = {**record, **track.get("geo", {}), **boxed, **track}
            rows.append([facts.get(name, "") for name in CSV_COLUMNS])
        return _csv(rows)


class GeoJsonFile(RecordFile):
    """A feature collection (RFC 7946): a point for each target at each time, where its place is known."""

    def __init__(self) -> None:
        self._separator = b""

    def begin(self) -> bytes:
        """The collection opens."""
        return b'{"type": "FeatureCollection", "features": ['

    def record(self, record: Record) -> bytes:
        """A feature a target."""
        written = b""
        for track in _located(record):
            place = track["geo"]
            names = ("id", "state", "score", "age_ns")
            facts = {name: track[name] for name in names} | {"source": record["source"], "seq": record["seq"]}
            if (time := utc_text(record)) is not None:
                facts["time"] = time
            if "error_m" in place:
                facts["error_m"] = place["error_m"]
            point = {"type": "Point", "coordinates": [place["lon"], place["lat"]]}
            feature = {"type": "Feature", "geometry": point, "properties": facts}
            written += self._separator + b"\n" + json.dumps(feature).encode()
            self._separator = b","
        return written

    def end(self) -> bytes:
        """The collection closes."""
        return b"\n]}\n"


class KmlFile(RecordFile):
    """KML 2.2: a placemark for each target at each time, where its place is known; viewers play them."""

    def begin(self) -> bytes:
        """The document opens."""
        return (
            b'<?xml version="1.0" encoding="UTF-8"?>\n'
            b'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        )

    def record(self, record: Record) -> bytes:
        """A placemark a target."""
        time = utc_text(record)
        when = f"<TimeStamp><when>{time}</when></TimeStamp>" if time else ""
        source = escape(xml_text(record["source"]))
        return "".join(
            f"<Placemark><name>{track['id']}</name><description>{source} {track['state']}</description>{when}"
            f"<Point><coordinates>{track['geo']['lon']:.8f},{track['geo']['lat']:.8f}</coordinates></Point>"
            "</Placemark>\n"
            for track in _located(record)
        ).encode()

    def end(self) -> bytes:
        """The document closes."""
        return b"</Document></kml>\n"


KINDS: dict[FileKind, type[RecordFile]] = {
    FileKind.MOT: MotFile,
    FileKind.CSV: CsvFile,
    FileKind.GEOJSON: GeoJsonFile,
    FileKind.KML: KmlFile,
}


def needs_places(kind: FileKind) -> bool:
    """Whether targets without a place on the ground are left out of such a file."""
    return kind in (FileKind.GEOJSON, FileKind.KML)


def utc_text(record: Record) -> str | None:
    """When a record's frame was captured, else published, in ISO 8601; None where neither is known."""
    time_ns = record.get("capture_ns", record.get("published_ns"))
    if time_ns is None:
        return None
    try:
        return (
            datetime.fromtimestamp(time_ns / 1e9, UTC)
            .isoformat(timespec="milliseconds")
            .replace("+00:00", "Z")
        )
    except (OverflowError, ValueError):
        return None


def xml_text(text: str) -> str:
    """The text without the characters that XML cannot have, escaped or not: records come from the network."""
    return NOT_IN_XML.sub("?", text)


def _shown(record: Record) -> Iterator[Mapping[str, Any]]:
    return (track for track in record["tracks"] if track["state"] in SHOWN)


def _located(record: Record) -> Iterator[Mapping[str, Any]]:
    return (track for track in _shown(record) if "geo" in track)


def _csv(rows: Iterable[Iterable[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
