"""tracksink: one complete line per frame, in order, or a clear error."""

from pathlib import Path

import numpy as np
import pytest

from streamkit import (
    Capture,
    ElementFailure,
    Frame,
    Pipeline,
    ResourceError,
    Tracks,
    decode_record,
    encode_record,
    raw_video_caps,
    track_record,
)
from streamkit.testing import Harness, ManualClock


def _frame(seq: int) -> Frame:
    caps = raw_video_caps("GRAY8", 4, 2)
    frame = Frame(
        np.zeros((2, 4), np.uint8), caps, pts=seq * 40, seq=seq, arrival_ns=1, capture=Capture(10, "file")
    )
    return frame.attach(Tracks())


def test_one_line_per_frame(tmp_path: Path) -> None:
    """Each line is the record of its frame, with the file's name as source."""
    path = tmp_path / "flight7.jsonl"
    clock = ManualClock(3_000_000)
    with Harness("tracksink", location=str(path), clock=clock) as harness:
        for seq in range(4):
            harness.push(_frame(seq))
        harness.drain()
        lines = path.read_bytes().splitlines()
    expected = [track_record(_frame(seq), source="flight7", published_ns=3_000_000) for seq in range(4)]
    assert [decode_record(line) for line in lines] == expected


def test_equal_runs_write_equal_files_without_stamp(tmp_path: Path) -> None:
    """Only the time of writing differs between two runs, and it can be left out."""
    paths = [tmp_path / name / "tracks.jsonl" for name in ("one", "two")]
    for path in paths:
        path.parent.mkdir()
        text = f"videotestsrc num-buffers=5 ! tracksink location={path} stamp=false"
        Pipeline.parse(text).run(timeout_s=30)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes().count(b"\n") == 5


def test_a_stop_without_eos_leaves_complete_lines(tmp_path: Path) -> None:
    """Frames rendered before a stop are in the file."""
    path = tmp_path / "tracks.jsonl"
    with Harness("tracksink", location=str(path), source="uav/9") as harness:
        harness.push(_frame(0))
    assert decode_record(path.read_bytes()).source == "uav/9"


def test_received_records_are_written_unchanged(tmp_path: Path) -> None:
    """Records from zenohsrc keep their source and times."""
    path = tmp_path / "tracks.jsonl"
    payload = encode_record(track_record(_frame(3), source="uav/1", published_ns=5))
    text = f"appsrc name=in caps=application/x-tracks ! tracksink location={path}"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline["in"].push(payload)
        pipeline["in"].end()
        pipeline.wait(10)
    assert path.read_bytes() == payload + b"\n"


def test_an_unwritable_location_is_an_error(tmp_path: Path) -> None:
    """The error names the location before the first frame; a missing folder is made with it."""
    (tmp_path / "folder.jsonl").mkdir()
    with pytest.raises(ResourceError, match="cannot be written: Is a directory"):
        Harness("tracksink", location=str(tmp_path / "folder.jsonl"))
    Pipeline.parse(f"videotestsrc num-buffers=2 ! tracksink location={tmp_path}/a/b/t.jsonl").run(
        timeout_s=30
    )
    assert (tmp_path / "a/b/t.jsonl").read_bytes().count(b"\n") == 2


def test_a_location_is_needed() -> None:
    """Location has no default."""
    with pytest.raises(ResourceError, match="location must be set"):
        Harness("tracksink")


def test_a_full_disk_is_reported() -> None:
    """A record that is not written is an error."""
    if not Path("/dev/full").exists():
        pytest.skip("/dev/full is not on this system")
    with pytest.raises(ElementFailure, match="cannot be written: No space left"):
        Pipeline.parse("videotestsrc num-buffers=50 ! tracksink location=/dev/full").run(timeout_s=30)


@pytest.mark.parametrize("name", ["a.kml", "a.geojson"])
def test_a_file_without_targets_does_not_replace_an_older_one(name: str, tmp_path: Path) -> None:
    """Where there is none it is written, and can be read."""
    path = tmp_path / name
    for older in (None, "older"):
        if older:
            path.write_text(older)
        with Harness("tracksink", location=str(path)) as harness:
            harness.push(_frame(0))
            harness.drain()
            assert harness.element.results["files"] == (0 if older else 1)
        assert list(tmp_path.iterdir()) == [path]
        written = path.read_text()
        assert written == older or written.rstrip().endswith(("</kml>", "]}"))


def test_the_standard_output_is_no_source(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """A stream without a file's name has that of the element."""
    with Harness("tracksink", location="-") as harness:
        harness.push(_frame(0))
    assert decode_record(capfdbinary.readouterr().out).source == "tracksink"
