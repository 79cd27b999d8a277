"""GeoJSON and KML hold a line for each target, whole at any time."""

import json
from typing import Any
from xml.etree import ElementTree

import pytest

from streamkit_tracks import trails
from streamkit_tracks.trails import GeoJsonTrails, KmlTrails, TrailFormat

SPACE = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}


def record(seq: int, **states: str) -> dict[str, Any]:
    """A record a second; target `t7` moves east by .01 deg a record."""
    tracks = [
        {"id": int(name[1:]), "state": state, "geo": {"lat": 48.5, "lon": 11.5 + seq / 100}}
        for name, state in states.items()
    ]
    return {
        "source": "uav <1>\x01",
        "seq": seq,
        "pts_ns": seq * 10**9,
        "capture_ns": seq * 10**9,
        "tracks": tracks,
    }


RECORDS = [
    record(0, t7="tentative", t8="confirmed"),
    record(1, t7="confirmed", t8="coasting"),
    record(2, t7="confirmed", t8="lost"),
    record(3, t7="coasting"),
]


def written(form: TrailFormat, records: list[dict[str, Any]]) -> bytes:
    """The file after these records."""
    return form.begin() + b"".join(map(form.record, records)) + form.end()


def lines(records: list[dict[str, Any]]) -> list[tuple[int, list[list[float]]]]:
    """Ids and coordinates of the GeoJSON after these records."""
    found = json.loads(written(GeoJsonTrails(), records))["features"]
    return [(one["properties"]["id"], one["geometry"]["coordinates"]) for one in found]


def test_a_target_is_a_line_at_any_time() -> None:
    """The one that is gone comes first; tentative and lost ones have no place."""
    assert lines([]) == []
    assert lines(RECORDS[:1]) == [(8, [11.5, 48.5])]  # a point
    assert lines(RECORDS) == [
        (8, [[11.5, 48.5], [11.51, 48.5]]),
        (7, [[11.51, 48.5], [11.52, 48.5], [11.53, 48.5]]),
    ]
    feature = json.loads(written(GeoJsonTrails(), RECORDS))["features"][0]
    assert feature["geometry"]["type"] == "LineString"
    assert feature["properties"] == {
        "id": 8, "source": "uav <1>\x01", "state": "coasting", "first_s": 0.0, "last_s": 1.0,
        "coordTimes": ["1970-01-01T00:00:00.000Z", "1970-01-01T00:00:01.000Z"],
    }  # fmt: skip


def test_a_long_line_is_continued(monkeypatch: pytest.MonkeyPatch) -> None:
    """From its last place: a target that stays for hours is not written anew each second."""
    monkeypatch.setattr(trails, "MAX_PLACES", 3)
    found = lines([record(seq, t7="confirmed") for seq in range(6)])
    assert [[place[0] for place in places] for _, places in found] == [
        [11.5, 11.51, 11.52], [11.52, 11.53, 11.54], [11.54, 11.55],
    ]  # fmt: skip


def test_lines_of_sources_that_ended_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest are completed."""
    monkeypatch.setattr(trails, "MAX_TRAILS", 3)
    form = GeoJsonTrails()
    form.begin()
    pieces = [form.record({**record(seq, t7="confirmed"), "source": f"uav/{seq}"}) for seq in range(6)]
    assert [b"uav/" in piece for piece in pieces] == [False] * 3 + [True] * 3
    assert form.end().count(b"uav/") == 3


def test_kml_has_a_track_or_a_line_without_times() -> None:
    """gx:Track pairs times and places in order."""
    root = ElementTree.fromstring(written(KmlTrails(), RECORDS))
    first, second = root.findall("k:Document/k:Placemark", SPACE)
    assert (first.findtext("k:name", None, SPACE), second.findtext("k:name", None, SPACE)) == ("8", "7")
    assert first.findtext("k:description", None, SPACE) == "uav <1>? coasting"
    whens = [when.text for when in second.findall("gx:Track/k:when", SPACE)]
    assert whens == [f"1970-01-01T00:00:0{second}.000Z" for second in (1, 2, 3)]
    places = [place.text for place in first.findall("gx:Track/gx:coord", SPACE)]
    assert places == ["11.50000000 48.50000000 0", "11.51000000 48.50000000 0"]
    timeless = [{**one, "capture_ns": None} for one in RECORDS]
    for one in timeless:
        del one["capture_ns"]
    mark = ElementTree.fromstring(written(KmlTrails(), timeless)).find("k:Document/k:Placemark", SPACE)
    assert mark is not None
    text = mark.findtext("k:LineString/k:coordinates", None, SPACE)
    assert text == "11.50000000,48.50000000 11.51000000,48.50000000"
    mark = ElementTree.fromstring(written(KmlTrails(), timeless[:1])).find("k:Document/k:Placemark", SPACE)
    assert mark is not None
    assert mark.findtext("k:Point/k:coordinates", None, SPACE) == "11.50000000,48.50000000"  # no line has one
