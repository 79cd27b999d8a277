"""tracksink, cotsink and mcapsink write the tracks of frames for other programs."""

import json
import math
import socket
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from streamkit import (
    Capture,
    Frame,
    Pipeline,
    Pose,
    ResourceError,
    Track,
    Tracks,
    TrackState,
    decode_record,
    raw_video_caps,
)
from streamkit.testing import Harness


def _frame(seq: int, posed: bool = True, number: int = 7) -> Frame:
    """A track at the centre of a frame that looks straight down from 100 m."""
    track = Track(number, TrackState.CONFIRMED, 31.5, 23.5, 8.0, 4.0, 0.0, (1.0, 2.0), np.eye(2), 0.5, 7)
    frame = Frame(
        np.zeros((48, 64), np.uint8), raw_video_caps("GRAY8", 64, 48), pts=seq * 40_000_000, seq=seq,
        arrival_ns=1, capture=Capture(1_763_690_000_000_000_000 + seq, "misb"),
    ).attach(Tracks((track,)))  # fmt: skip
    pose = Pose(
        48.0, 11.0, 600.0, heading=0.0, pitch=0.0, roll=0.0, sensor_angles=(0.0, -math.pi / 2, 0.0),
        field_of_view=(1.0, 0.8),
    )  # fmt: skip
    return frame.attach(pose) if posed else frame


def _written(path: Path, **properties: object) -> bytes:
    with Harness("tracksink", location=str(path), **properties) as harness:
        for seq in range(3):
            harness.push(_frame(seq))
        harness.drain()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("name", "beginning"),
    [
        ("a.jsonl", b'{"schema":'),
        ("a.txt", b"1,7,29,23,8,4,0.5,-1,-1,-1\n"),
        ("a.csv", b"source,seq,"),
        ("a.geojson", b'{"type": "FeatureCollection"'),
        ("a.kml", b"<?xml"),
        ("a.cot", b'<?xml version="1.0" encoding="UTF-8"?><event version="2.0" uid="streamkit.a.7"'),
    ],
)
def test_the_suffix_selects_the_format(tmp_path: Path, name: str, beginning: bytes) -> None:
    """Complete files."""
    assert _written(tmp_path / name, ground_altitude=500).startswith(beginning)
    given = {".jsonl": "jsonl", ".txt": "mot"}.get(Path(name).suffix, Path(name).suffix[1:])
    assert _written(tmp_path / "other", format=given, ground_altitude=500, source="a").startswith(beginning)


def test_coordinates_follow_from_pose_and_ground(tmp_path: Path) -> None:
    """A target below the camera has the camera's coordinates, also in the record."""
    collection = json.loads(_written(tmp_path / "a.geojson", ground_altitude=500, points=True))
    assert len(collection["features"]) == 3
    np.testing.assert_allclose(collection["features"][0]["geometry"]["coordinates"], [11.0, 48.0], atol=1e-9)
    record = decode_record(_written(tmp_path / "a.jsonl", ground_altitude=500).splitlines()[0])
    assert record.tracks[0].geo is not None
    assert record.tracks[0].geo.lat == pytest.approx(48.0)
    assert decode_record(_written(tmp_path / "b.jsonl").splitlines()[0]).tracks[0].geo is None


def test_targets_without_coordinates_are_counted(tmp_path: Path) -> None:
    """The reason of an empty map is counted."""
    with Harness("tracksink", location=str(tmp_path / "a.kml")) as harness:
        harness.push(_frame(0, posed=False))
        assert harness.element.drops["no target with a place"] == 1


def test_a_file_is_complete_without_eos(tmp_path: Path) -> None:
    """A stop ends the file as EOS does."""
    path = tmp_path / "a.geojson"
    with Harness("tracksink", location=str(path), ground_altitude=500) as harness:
        harness.push(_frame(0))
    assert len(json.loads(path.read_bytes())["features"]) == 1


def test_mcap_has_records_schema_and_times(tmp_path: Path) -> None:
    """The mcap library reads JSON with its JSON Schema, at the time of capture."""
    path = tmp_path / "a.mcap"
    with Harness("mcapsink", location=str(path), topic="/uav/tracks") as harness:
        for seq in range(3):
            harness.push(_frame(seq))
        harness.drain()
    with path.open("rb") as file:
        found = list(make_reader(file).iter_messages())
    assert [json.loads(message.data)["seq"] for _, _, message in found] == [0, 1, 2]
    schema, channel, message = found[1]
    assert schema is not None
    assert (schema.name, schema.encoding, channel.topic) == (
        "streamkit.tracks/1",
        "jsonschema",
        "/uav/tracks",
    )
    assert json.loads(schema.data)["title"] == "streamkit.tracks/1"
    assert (message.log_time, channel.message_encoding) == (1_763_690_000_000_000_001, "json")


@pytest.mark.parametrize("location", ["", "/etc/passwd/a.mcap"])
def test_mcap_needs_a_location(location: str) -> None:
    """Without a writable location it does not start."""
    with pytest.raises(ResourceError, match="location"):
        Harness("mcapsink", location=location)


@pytest.mark.parametrize("element", ["mcapsink", "tracksink"])
def test_a_full_disk_is_reported_once(element: str) -> None:
    """Once, with a remedy; the stop reports nothing."""
    text = f"videotestsrc ! {element} location=/dev/full"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.wait(30)
        assert message is not None
        assert "cannot be written: No space left on device; free some space" in message.text
        pipeline.stop()
        while (message := pipeline.bus.pop(0.0)) is not None:
            assert "stop failed" not in message.text


def test_cot_sends_targets_with_coordinates() -> None:
    """One datagram per target and interval; a target without coordinates sends none, and nothing is lost."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        address = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        with Harness(
            "cotsink", address=address, ground_altitude=500, interval_s=3600, source="uav/1"
        ) as harness:
            harness.push(_frame(0, posed=False))
            harness.push(_frame(1))
            harness.push(_frame(2))
            harness.push(_frame(3, number=8))
            harness.drain()
            assert not harness.element.drops
            assert b'uid="streamkit.uav/1.7"' in receiver.recv(2000)
            assert b'uid="streamkit.uav/1.8"' in receiver.recv(2000)
            receiver.settimeout(0.1)
            with pytest.raises(TimeoutError):
                receiver.recv(2000)


def test_a_lost_server_is_reported_and_does_not_end_the_stream() -> None:
    """Events that cannot be sent are counted; the warning names the address."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5)
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with Harness(
            "cotsink", address=address, ground_altitude=500, interval_s=0, max_queue=1000
        ) as harness:
            link, _ = server.accept()
            link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            link.close()
            for seq in range(200):
                harness.push(_frame(seq))
            harness.drain()
            assert harness.element.drops["not sent"] >= 1
            assert any(f"events to {address} are not sent" in message.text for message in harness.messages)
    with pytest.raises(ResourceError, match="start the server"):
        Harness("cotsink", address=address)
    with pytest.raises(ResourceError, match="udp://HOST:PORT"):
        Harness("cotsink", address="here")
