"""Detections in files."""

import json

import numpy as np
import pytest

from streamkit import Detections, Frame, Pipeline, ResourceError, raw_video_caps
from streamkit.testing import Harness

CAPS = raw_video_caps("GRAY8", 64, 48)
FOUND = Detections(
    np.array([[9.5, 4.5], [30.0, 20.0]]),
    np.array([[-0.5, -0.5, 19.5, 9.5], [24.5, 14.5, 34.5, 24.5]]),
    np.array([150.0, 80.0]),
    np.array([0.9, 0.25]),
)


def written(path, **properties):
    """The file after a frame with two detections and a frame without any."""
    with Harness("detectionsink", location=str(path), **properties) as harness:
        picture = np.zeros((48, 64), np.uint8)
        harness.push(Frame(picture, CAPS, seq=7, pts=40_000_000).attach(FOUND))
        harness.push(Frame(picture, CAPS, seq=8, pts=80_000_000))
    return path.read_text()


def test_json_lines(tmp_path):
    """A line for each frame, in the stream's coordinates."""
    lines = [json.loads(line) for line in written(tmp_path / "d.jsonl").splitlines()]
    assert [(line["frame"], line["seq"], line["pts_ns"]) for line in lines] == [
        (1, 7, 40_000_000),
        (2, 8, 80_000_000),
    ]
    assert lines[0]["detections"][0] == {
        "box": [-0.5, -0.5, 19.5, 9.5],
        "centroid": [9.5, 4.5],
        "area": 150.0,
        "score": 0.9,
    }
    assert lines[1]["detections"] == []


def test_mot(tmp_path):
    """The first pixel is 1, 1; the identity is -1."""
    assert written(tmp_path / "det.txt").splitlines() == [
        "1,-1,1.00,1.00,20.00,10.00,0.9000,-1,-1,-1",
        "1,-1,26.00,16.00,10.00,10.00,0.2500,-1,-1,-1",
    ]


def test_coco(tmp_path):
    """One object; every frame is an image, boxes count from the image's corner."""
    data = json.loads(written(tmp_path / "d.json"))
    assert [image["id"] for image in data["images"]] == [1, 2]
    assert data["images"][0]["width"] == 64
    assert data["annotations"][0]["bbox"] == [0.0, 0.0, 20.0, 10.0]
    assert [row["id"] for row in data["annotations"]] == [1, 2]
    assert data["categories"] == [{"id": 1, "name": "moving"}]


def test_the_format_can_be_named(tmp_path):
    """Whatever the file is called."""
    assert written(tmp_path / "x.dat", format="mot").startswith("1,-1,")


def test_a_stream_without_a_frame_leaves_the_older_file(tmp_path):
    """A run that made nothing does not replace the last result; the warning says so."""
    path = tmp_path / "d.json"
    path.write_text("{}")
    with Harness("detectionsink", location=str(path)) as harness:
        harness.drain()
        assert any("no frame came, nothing is written" in message.text for message in harness.messages)
    assert path.read_text() == "{}"


def test_a_place_that_cannot_be_written(tmp_path):
    """The error names it, and the remedy."""
    (tmp_path / "file").touch()
    with pytest.raises(ResourceError, match=r"cannot be written: Not a directory; check that"):
        Harness("detectionsink", location=str(tmp_path / "file" / "d.jsonl"))
    with pytest.raises(ResourceError, match="location must be set"):
        Harness("detectionsink")


def test_behind_framediff(tmp_path):
    """A line per frame of a real pipeline."""
    path = tmp_path / "d.jsonl"
    Pipeline.parse(
        f"videotestsrc num-buffers=6 ! video/x-raw, width=160, height=120 ! framediff ! detectionsink"
        f" location={path}"
    ).run(timeout_s=30)
    assert [json.loads(line)["frame"] for line in path.read_text().splitlines()] == [1, 2, 3, 4, 5, 6]
