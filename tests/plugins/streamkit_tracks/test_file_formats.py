"""Files follow their formats, and hold the values of the records."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import pytest

from streamkit_tracks.cursor_on_target import events
from streamkit_tracks.file_formats import FORMATS, FileKind, iso_text, utc_time


def _track(number: int, state: str = "confirmed", **more: Any) -> dict[str, Any]:
    return {
        "id": number, "state": state, "x": 20.0, "y": 30.0, "length": 8.0, "width": 4.0, "angle": 0.5,
        "bbox": [16.0, 27.5, 24.0, 32.5], "score": 0.875, "age_ns": 5, **more,
    }  # fmt: skip


def _record(seq: int, *tracks: dict[str, Any]) -> dict[str, Any]:
    return {
        "schema": "streamkit.tracks/1", "source": "uav <1>\x01", "seq": seq, "epoch": 0,
        "capture_ns": 1_763_690_000_123_456_789, "width": 64, "height": 48, "dropped": 0,
        "tracks": list(tracks),
    }  # fmt: skip


PLACED = {"geo": {"lat": 48.125, "lon": 11.5, "error_m": 3.5}}
RECORDS = [
    _record(0, _track(7, **PLACED), _track(8, "tentative", **PLACED)),
    _record(1),
    _record(2, _track(7, vx=1.5)),
]


def _written(kind: FileKind, records: Sequence[dict[str, Any]] = RECORDS) -> str:
    file = FORMATS[kind]()
    return (file.begin() + b"".join(map(file.record, records)) + file.end()).decode()


def test_mot_counts_frames_from_one() -> None:
    """Frame, id, left, top, width, height, score and three times -1; tentative targets are no results.

    Pixels count from 1, too: the left edge of the first one is at 1, which is -0.5 in a frame.
    """
    assert _written(FileKind.MOT).splitlines() == [
        "1,7,17.5,29,8,5,0.875,-1,-1,-1",
        "3,7,17.5,29,8,5,0.875,-1,-1,-1",
    ]


def test_csv_has_a_row_per_target() -> None:
    """`width` is the target's, not the frame's, and unknown values are empty."""
    rows = list(csv.DictReader(io.StringIO(_written(FileKind.CSV))))
    assert [(row["seq"], row["id"], row["state"]) for row in rows] == [
        ("0", "7", "confirmed"), ("0", "8", "tentative"), ("2", "7", "confirmed"),
    ]  # fmt: skip
    assert (rows[0]["width"], rows[0]["lat"], rows[0]["x1"]) == ("4.0", "48.125", "24.0")
    assert (rows[0]["error_m"], rows[2]["error_m"]) == ("3.5", "")
    assert (rows[2]["vx"], rows[2]["lat"]) == ("1.5", "")


def test_geojson_is_a_collection_of_points() -> None:
    """Longitude comes first; only confirmed targets with coordinates are there."""
    collection = json.loads(_written(FileKind.GEOJSON))
    (feature,) = collection["features"]
    assert feature["geometry"] == {"type": "Point", "coordinates": [11.5, 48.125]}
    assert feature["properties"]["id"] == 7
    assert feature["properties"]["time"] == "2025-11-21T01:53:20.123Z"
    file = FORMATS[FileKind.GEOJSON]()
    assert json.loads(file.begin() + file.end()) == {"type": "FeatureCollection", "features": []}


def test_kml_is_a_document_of_placemarks() -> None:
    """Well-formed for any name of the source, with time and coordinates."""
    root = ElementTree.fromstring(_written(FileKind.KML))
    space = {"k": "http://www.opengis.net/kml/2.2"}
    (mark,) = root.findall("k:Document/k:Placemark", space)
    assert mark.findtext("k:name", namespaces=space) == "7"
    assert mark.findtext("k:description", namespaces=space) == "uav <1>? confirmed"
    assert mark.findtext("k:TimeStamp/k:when", namespaces=space) == "2025-11-21T01:53:20.123Z"
    assert mark.findtext("k:Point/k:coordinates", namespaces=space) == "11.50000000,48.12500000"


@pytest.mark.parametrize(
    ("time_ns", "expected"), [(None, None), (0, "1970-01-01T00:00:00.000Z"), (10**25, None)]
)
def test_an_invalid_time_is_left_out(time_ns: int | None, expected: str | None) -> None:
    """A year beyond the calendar is invalid."""
    time = utc_time(time_ns)
    assert (None if time is None else iso_text(time)) == expected


def test_a_time_of_processing_is_no_time_of_capture() -> None:
    """A position of unknown UTC has none; a CoT event, which needs a time, has that of publishing."""
    record = _record(0, _track(7, **PLACED)) | {"pts_ns": 40_000_000, "published_ns": 5 * 10**9}
    del record["capture_ns"]
    feature = json.loads(_written(FileKind.GEOJSON, [record]))["features"][0]
    assert "time" not in feature["properties"]
    assert feature["properties"]["pts_ns"] == record["pts_ns"]
    assert "<when>" not in _written(FileKind.KML, [record])
    (event,) = events(record, "a-u-G", 5.0)
    assert b'time="1970-01-01T00:00:05.000Z"' in event


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [(33_333_333, "00:00:00.033Z"), (66_666_667, "00:00:00.067Z"), (999_999_999, "00:00:01.000Z")],
)
def test_times_are_rounded_to_the_nearest_millisecond(time_ns: int, text: str) -> None:
    """Cut off, those of a camera of 30/s would be off by a third of a millisecond on the average."""
    time = utc_time(time_ns)
    assert time is not None
    assert iso_text(time) == f"1970-01-01T{text}"
