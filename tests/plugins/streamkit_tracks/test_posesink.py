"""posesink: the KML of a flight path, read as a viewer reads it."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from streamkit import Capture, Frame, MessageKind, Pipeline, Pose, raw_video_caps
from streamkit.testing import Harness
from streamkit_tracks.flight_path import view_outline

KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"
POSE = Pose(48.0, 11.0, 600.0, heading=math.radians(90), field_of_view=(0.8, 0.6), ground_altitude=500.0)
SECOND = 10**9


def frame(number: int, pose: Pose | None = POSE, epoch: int = 0, capture: bool = True) -> Frame:
    """A frame of a film at 2/s."""
    pts = number * SECOND // 2
    taken = Capture(1_700_000_000 * SECOND + pts, "misb") if capture else None
    made = Frame(
        np.zeros((60, 80), np.uint8), raw_video_caps("GRAY8", 80, 60), pts=pts, epoch=epoch, capture=taken
    )
    return made if pose is None else made.attach(pose)


def written(path: Path, frames: list[Frame], **properties: object) -> ET.Element:
    """The document that posesink writes of frames."""
    with Harness("posesink", location=str(path), **properties) as harness:
        for one in frames:
            harness.push(one)
        harness.drain()
    return ET.parse(path).getroot()


def texts(root: ET.Element, name: str) -> list[str]:
    """The texts of all elements of a name."""
    return [found.text or "" for found in root.iter(name)]


def test_a_real_flight(streamkit_data: Path, tmp_path: Path) -> None:
    """Positions, times and headings are the telemetry's; the view is where it looks."""
    path = tmp_path / "flight.kml"
    source = streamkit_data / "telemetry" / "sample-stream.ts"
    text = (
        f"filesrc name=s location={source}  s.video ! posesync name=p ! posesink location={path}  "
        "s.klv ! p.telemetry"
    )
    Pipeline.parse(text).run(timeout_s=40)
    root = ET.parse(path).getroot()
    times = [datetime.fromisoformat(text) for text in texts(root, f"{KML}when")]
    places = np.array([text.split() for text in texts(root, f"{GX}coord")], float)
    headings = [float(text.split()[0]) for text in texts(root, f"{GX}angles")]
    assert len(times) == len(places) == len(headings) == 10
    steps = np.diff([time.timestamp() for time in times])
    assert np.abs(steps - 1).max() < 0.1
    # The platform flies where its heading points, and its altitude is that of the film.
    east, north = np.diff(places[:, 0]) * math.cos(math.radians(34.7)), np.diff(places[:, 1])
    course = np.degrees(np.arctan2(east, north)) % 360
    assert np.abs(course - headings[:-1]).max() < 8
    assert np.abs(places[:, 2] - 3048).max() < 5
    rings = [
        np.array([pair.split(",") for pair in text.split()], float)
        for text in texts(root, f"{KML}coordinates")
    ]
    assert len(rings) == 10
    assert all(np.abs(ring.mean(axis=0) - places[0, :2]).max() < 0.1 for ring in rings)
    assert {len(ring) for ring in rings} == {5}


def test_positions_come_once_an_interval(tmp_path: Path) -> None:
    """And with another epoch at once; those that are stale or missing are left out."""
    frames = [frame(number) for number in range(5)]
    frames += [frame(5, None), frame(6, Pose(1.0, 2.0, is_stale=True)), frame(1, epoch=1)]
    root = written(tmp_path / "a.kml", frames)
    assert texts(root, f"{KML}when") == [
        "2023-11-14T22:13:20.000Z",
        "2023-11-14T22:13:21.000Z",
        "2023-11-14T22:13:22.000Z",
        "2023-11-14T22:13:20.500Z",
    ]
    assert texts(root, f"{GX}coord")[0] == "11.0000000 48.0000000 600.0"
    assert texts(root, f"{GX}angles")[0] == "90.00 0 0"
    assert texts(root, f"{KML}altitudeMode") == ["absolute"]


def test_what_is_unknown_is_left_empty(tmp_path: Path) -> None:
    """No heading or altitude is made up."""
    root = written(tmp_path / "a.kml", [frame(0, Pose(48.0, 11.0))])
    assert texts(root, f"{GX}angles") == [""]
    assert texts(root, f"{KML}altitudeMode") == ["clampToGround"]
    assert set(texts(root, f"{GX}value")) == {""}
    assert not texts(root, f"{KML}coordinates")


@pytest.mark.parametrize(("count", "kind"), [(4, "LineString"), (1, "Point")])
def test_without_times_the_path_is_a_line(tmp_path: Path, count: int, kind: str) -> None:
    """As of DJI's subtitles: no `when` may be empty, and no line has one position."""
    pose = replace(POSE, source="dji above take-off")
    frames = [frame(2 * number, pose, capture=number == 1) for number in range(count)]
    root = written(tmp_path / "a.kml", frames, views=False)
    assert not list(root.iter(f"{GX}Track"))
    (line,) = root.iter(f"{KML}{kind}")
    assert [child.text for child in line] == [
        "relativeToGround",
        " ".join(["11.0000000,48.0000000,600.0"] * count),
    ]


@pytest.mark.parametrize(
    ("source", "mode"),
    [
        ("misb", "absolute"),
        ("dji above take-off", "relativeToGround"),
        ("dji above ground", "relativeToGround"),
    ],
)
def test_altitudes_are_drawn_with_their_datum(tmp_path: Path, source: str, mode: str) -> None:
    """Above the ground where telemetry says so."""
    root = written(tmp_path / "a.kml", [frame(0, replace(POSE, source=source))])
    assert texts(root, f"{KML}altitudeMode") == [mode]


def test_the_view_is_computed_where_telemetry_has_no_corners() -> None:
    """Straight down from 100 m: twice the tangent of half the angle, turned with the heading."""
    outline = np.array(view_outline(POSE, (60, 80), None))
    metres = (outline - (48.0, 11.0)) * (111_200, 111_320 * math.cos(math.radians(48.0)))
    assert np.abs(np.abs(metres[:, 0]) - 100 * math.tan(0.4)).max() < 2
    assert np.abs(np.abs(metres[:, 1]) - 100 * math.tan(0.3)).max() < 2
    assert view_outline(Pose(48.0, 11.0, 600.0), (60, 80), 500.0) == ()
    towards_horizon = Pose(
        48.0, 11.0, 600.0, heading=0.0, sensor_angles=(0.0, -0.1, 0.0), field_of_view=(0.8, 0.6)
    )
    assert view_outline(towards_horizon, (60, 80), 500.0) == ()
    assert view_outline(POSE, None, None) == ()


@pytest.mark.parametrize("count", [1, 300])
def test_the_file_is_whole_while_it_grows(tmp_path: Path, count: int) -> None:
    """A viewer reads it at any time; it is not written with every position of a long flight."""
    path = tmp_path / "a.kml"
    with Harness("posesink", location=str(path), interval_s=0.0) as harness:
        for number in range(count):
            harness.push(frame(number))
        assert len(texts(ET.parse(path).getroot(), f"{KML}when")) >= 1
        harness.drain()
    root = ET.parse(path).getroot()
    assert len(texts(root, f"{KML}when")) == len(texts(root, f"{KML}coordinates")) == count


def test_without_poses_the_run_tells_why(tmp_path: Path) -> None:
    """No pose came."""
    text = f"videotestsrc num-buffers=3 ! posesink location={tmp_path / 'a.kml'}"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.bus.pop(20, (MessageKind.WARNING,))
    assert message is not None
    assert "no frame has a pose; pair telemetry with posesync" in message.text


def test_stale_poses_are_the_reason(tmp_path: Path) -> None:
    """Telemetry is there, but of another time: its offset is what to look at."""
    with Harness("posesink", location=str(tmp_path / "a.kml")) as harness:
        harness.push(frame(0, replace(POSE, is_stale=True)))
        harness.drain()
    (message,) = (message for message in harness.messages if message.kind is MessageKind.WARNING)
    assert "the poses of all 1 frames that have one are stale" in message.text
    assert "offset-s" in message.text


def test_a_run_without_poses_leaves_the_older_file(tmp_path: Path) -> None:
    """A path without positions is of no use."""
    path = tmp_path / "flight.kml"
    path.write_text("older")
    Pipeline.parse(f"videotestsrc num-buffers=3 ! posesink location={path}").run(20)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]
