"""rerunsink: what Rerun's own reader finds in the recording."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streamkit import Frame, PropertyError, Registration, Track, Tracks, TrackState, raw_video_caps
from streamkit.testing import Harness

pytestmark = pytest.mark.skipif(
    not find_spec("rerun"), reason="rerun-sdk, the extra `rerun`, is not installed"
)


def frames(count: int) -> list[Frame]:
    """Frames with one target, on a plane that is 10 px to the left."""
    registration = Registration(np.eye(3), np.array([[1.0, 0, 10], [0, 1, 0], [0, 0, 1]]))
    pixels = np.full((48, 64, 3), 128, np.uint8)
    made = []
    for number in range(count):
        track = Track(
            id=7, state=TrackState.CONFIRMED, x=20.0 + number, y=15.0, length=8.0, width=4.0, angle=0.0,
            velocity=(1.0, 0.0), covariance=np.eye(2), score=0.9, age_ns=0,
        )  # fmt: skip
        caps = raw_video_caps("BGR", 64, 48, None)
        made.append(
            Frame(pixels, caps, pts=number * 40_000_000, seq=number).attach(Tracks((track,)), registration)
        )
    return made


def test_the_recording_has_images_boxes_and_points_at_their_times(tmp_path: Path) -> None:
    """Each frame on the timelines frame and pts."""
    from rerun.chunk import RrdReader

    path = tmp_path / "run.rrd"
    with Harness("rerunsink", location=str(path)) as harness:
        for frame in frames(5):
            harness.push(frame)
        harness.drain()
    found: dict[tuple[str, str], list[Any]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if name == "frame" or ":" in name:
                found.setdefault((chunk.entity_path, name), []).extend(column.to_pylist())
    assert sorted(found["/camera", "frame"]) == [0, 1, 2, 3, 4]
    assert len(found["/camera", "EncodedImage:blob"]) == 5
    centres = sorted(row[0] for row in found["/camera/tracks", "Boxes2D:centers"])
    assert np.allclose(centres, [[20 + number, 15] for number in range(5)], atol=0.01)
    points = sorted(row[0] for row in found["/plane/tracks", "Points2D:positions"])
    assert np.allclose(points, [[30 + number, 15] for number in range(5)], atol=0.01)
    assert found["/camera/tracks", "Boxes2D:labels"] == [["7"]] * 5
    assert found["/targets", "Scalars:scalars"] == [[1.0]] * 5


def test_another_ending_is_refused() -> None:
    """Rerun opens .rrd."""
    with pytest.raises(PropertyError, match=r"\.rrd"):
        Harness("rerunsink", location="run.mcap")
