"""detectionsrc in pipelines."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Detections, ElementFailure, Frame, Message, Pipeline, Tracks, raw_video_caps
from streamkit.testing import Harness
from streamkit_differencer.detectionsrc import read_detections

MOT = "1,-1,1,1,10,20,0.9,-1,-1,-1\n1,-1,31,1,10,20,0.2,-1,-1,-1\n3,-1,1,1,10,20,0.5,-1,-1,-1\n"


def given_detections(path: Path, settings: str = "") -> list[Detections]:
    """The detections of three frames."""
    text = f"videotestsrc num-buffers=3 ! detectionsrc location={path} {settings} ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        found = [frame.get(Detections) for frame in pipeline["out"]]
    assert len(found) == 3
    return [detections for detections in found if detections is not None]


def test_each_frame_gets_the_rows_with_its_number(tmp_path: Path):
    """MOT counts frames and pixels from 1; a box begins half a pixel before the centre of its first."""
    path = tmp_path / "det.txt"
    path.write_text(MOT)
    first, second, third = given_detections(path)
    assert (len(first), len(second), len(third)) == (2, 0, 1)
    assert first.boxes[0].tolist() == [-0.5, -0.5, 9.5, 19.5]
    assert first.centroids[1].tolist() == [34.5, 9.5]
    assert first.areas.tolist() == [200.0, 200.0]
    assert first.scores.tolist() == [0.9, 0.2]
    assert first.labels == ("object", "object")


def test_low_scores_are_left_out(tmp_path: Path):
    """In the units of the file."""
    path = tmp_path / "det.txt"
    path.write_text(MOT)
    assert [len(found) for found in given_detections(path, "min-score=0.5")] == [1, 0, 1]


def test_scores_of_any_scale_become_0_to_1(tmp_path: Path):
    """The lowest of the file is 0, the highest 1."""
    path = tmp_path / "det.txt"
    path.write_text("1,-1,1,1,5,5,-10\n2,-1,1,1,5,5,90\n3,-1,1,1,5,5,40\n")
    assert [found.scores.tolist() for found in given_detections(path)] == [[0.0], [1.0], [0.5]]


def test_what_detectionsink_writes_is_read_back(tmp_path: Path):
    """JSON lines and MOT text, to the digits written."""
    for name in ("found.jsonl", "found.txt"):
        first, second = tmp_path / name, tmp_path / f"again-{name}"
        Pipeline.parse(
            "dronetestsrc num-buffers=25 cars=6 ! video/x-raw, width=320, height=240 ! framediff motion=none "
            f"! detectionsink location={first}"
        ).run(timeout_s=60)
        Pipeline.parse(
            "videotestsrc num-buffers=25 ! video/x-raw, width=320, height=240 "
            f"! detectionsrc location={first} ! detectionsink location={second}"
        ).run(timeout_s=60)
        one, two = read_detections(str(first)), read_detections(str(second))
        assert len(one.frames)
        assert np.array_equal(one.frames, two.frames)
        assert np.allclose(one.boxes, two.boxes, atol=0.02)


def test_what_stands_still_or_overlaps_is_tracked_as_objects(tmp_path: Path):
    """One stands, another passes before it; each keeps its id, which regions of motion would not."""
    path = tmp_path / "det.txt"
    rows = [f"{n},-1,{left},20,30,60,1\n" for n in range(1, 41) for left in (100, 40 + 4 * n)]
    path.write_text("".join(rows))
    with Harness("detectionsrc", location=str(path)) as given_boxes, Harness("particletrack") as tracker:
        seen: list[dict[int, float]] = []
        for seq in range(40):
            frame = Frame(
                np.zeros((120, 320), np.uint8),
                raw_video_caps("GRAY8", 320, 120),
                pts=seq * 40_000_000,
                seq=seq,
            )
            for out in tracker.push(*given_boxes.push(frame)):
                tracks = out.get(Tracks)
                assert tracks is not None
                seen.append({track.id: track.x for track in tracks.tracks if track.state == "confirmed"})
    ids = set().union(*seen[5:])
    assert len(ids) == 2
    standing = min(ids, key=lambda number: abs(seen[-1][number] - 113.5))
    (passing,) = ids - {standing}
    assert seen[-1][standing] == pytest.approx(113.5, abs=2)
    assert seen[-1][passing] == pytest.approx(213.5, abs=4)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("1,-1,5,5,10\n", "det.txt:1: a detection has"),
        ("1,-1,1,1,5,5,1\n1,-1,5,5,0,10,1\n", "det.txt:2: a detection has"),
        ("1,-1,nan,5,5,10,1\n", "det.txt:1: a detection has"),
        ("1e300,-1,1,5,5,10,1\n", "det.txt:1: a detection has"),
        ("hello\n", "det.txt:1: a detection has"),
    ],
)
def test_a_line_that_is_no_detection_is_told(tmp_path: Path, text: str, rule: str):
    """With file, line, rule and what was found."""
    path = tmp_path / "det.txt"
    path.write_text(text)
    with pytest.raises(ElementFailure, match=rule):
        given_detections(path)


def test_a_binary_file_is_not_printed(tmp_path: Path):
    """Its bytes say nothing to a user."""
    path = tmp_path / "det.jsonl"
    path.write_bytes(b"\0\0\0\x20ftypisom\xff\xfe\n")
    with pytest.raises(ElementFailure, match=r"jsonl:1: .* got bytes that are no text; check the path"):
        given_detections(path)


@pytest.mark.parametrize(
    ("text", "settings", "warning"),
    [
        (MOT, "", ""),
        ("", "", "the file is empty"),
        ("0,-1,1,1,5,5,1\n1,-1,1,1,5,5,1\n", "", "numbered from 0, the frames from 1; set first-number=0"),
        ("0,-1,1,1,5,5,1\n1,-1,1,1,5,5,1\n", "first-number=0", ""),
        (MOT, "first-number=5000", "no row matched a frame: rows are numbered 1..3, frames 5000..5002"),
        (MOT, "min-score=1e9", "no row has a score of min-score=1e+09: the scores are 0.2 to 0.9"),
        (MOT.replace(",1,1,10", ",999,1,10"), "", "2 of 3 boxes lie outside the frame: are they of another"),
    ],
)
def test_a_file_that_does_not_fit_is_told(tmp_path: Path, text: str, settings: str, warning: str):
    """At the end, as a shortfall."""
    path = tmp_path / "det.txt"
    path.write_text(text)
    warnings: list[Message] = []
    with Pipeline.parse(
        f"videotestsrc num-buffers=3 ! detectionsrc location={path} {settings} ! fakesink"
    ) as run:
        run.bus.watch(lambda message: warnings.append(message) if message.kind == "warning" else None)
        run.run(timeout_s=30)
    assert bool(warnings) is bool(warning)
    assert all(warning in message.text and message.fields["code"] == "shortfall" for message in warnings)


@pytest.mark.parametrize(
    ("times_s", "settings", "warning"),
    [
        ((0, 0.04, 0.08), "", ""),
        ((5, 5.04, 5.08), "", ""),  # of a container whose times begin elsewhere
        ((-0.08, -0.04, 0), "", "frame 1 of the file is of -0.080 s, the first frame of 0.000 s, which"),
        ((-0.08, -0.04, 0), "first-number=3", ""),
    ],
)
def test_rows_of_other_times_are_told(
    tmp_path: Path, times_s: tuple[float, ...], settings: str, warning: str
):
    """As where a detector saw the whole file, and start-s leaves out its beginning: numbers alone fit."""
    path = tmp_path / "det.jsonl"
    found = [{"box": [1, 1, 5, 5], "score": 1}]
    rows = [{"frame": n, "pts_ns": round(s * 1e9), "detections": found} for n, s in enumerate(times_s, 1)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    warned: list[str] = []
    text = f"videotestsrc num-buffers=1 ! detectionsrc location={path} {settings} ! fakesink"
    with Pipeline.parse(text) as run:
        run.bus.watch(lambda message: warned.append(message.text) if message.kind == "warning" else None)
        run.run(timeout_s=30)
    assert [warning in text for text in warned] == [True] * bool(warning)


def test_an_empty_scene_fits(tmp_path: Path):
    """Records of frames without detections are no fault."""
    path = tmp_path / "det.jsonl"
    path.write_text('{"frame": 1, "detections": []}\n')
    with Harness("detectionsrc", location=str(path)) as harness:
        harness.push(Frame(np.zeros((8, 8), np.uint8), raw_video_caps("GRAY8", 8, 8)))
        harness.drain()
    assert not [message for message in harness.messages if message.kind == "warning"]


def test_a_missing_file_is_told(tmp_path: Path):
    """And one that was not named."""
    with pytest.raises(ElementFailure, match=r"none\.txt: cannot be read: No such file"):
        given_detections(tmp_path / "none.txt")
    with pytest.raises(ElementFailure, match="location must be set"):
        Pipeline.parse("videotestsrc num-buffers=1 ! detectionsrc ! fakesink").run(timeout_s=20)


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str):
    """Never another error."""
    for name in ("det.txt", "det.jsonl"):
        path = tmp_path_factory.getbasetemp() / name
        path.write_text(text, encoding="utf-8", errors="replace")
        try:
            table = read_detections(str(path))
        except ValueError:
            continue
        assert len(table.frames) == len(table.boxes)
