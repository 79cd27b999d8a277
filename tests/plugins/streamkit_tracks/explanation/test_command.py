"""`streamkit explain` on files of records."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from streamkit import Pipeline
from streamkit_tracker import associate
from streamkit_tracks.explanation.command import GATE, explain

STEP_NS = 40_000_000


def run(*words: object) -> Result:
    """The command, run in this process."""
    app = typer.Typer()
    app.command()(explain)
    return CliRunner().invoke(app, [str(word) for word in words])


def target(number: int, state: str, **more: Any) -> dict[str, Any]:
    """A row of a record."""
    place = {"x": 50.0, "y": 40.0, "length": 20.0, "width": 10.0, "angle": 0.5, "bbox": [40, 30, 60, 50]}
    return {"id": number, "state": state, **place, "score": 0.9, "age_ns": 10**9, **more}


def record(seq: int, *targets: dict[str, Any], epoch: int = 0, pts_ns: int | None = None) -> str:
    """A line of tracksink."""
    place = {"reference": 3, "status": "ok", "matches": 200, "inliers": 180, "rmse": 0.25}
    fields = {"schema": "streamkit.tracks/1", "source": "f", "seq": seq, "epoch": epoch, "dropped": 0}
    pts_ns = seq * STEP_NS if pts_ns is None else pts_ns
    return json.dumps({**fields, "pts_ns": pts_ns, "registration": place, "tracks": targets}) + "\n"


def life(path: Path) -> Path:
    """A track that begins in frame 10, is confirmed, not detected once, and leaves in frame 14."""
    match = {"row": 2, "centroid": [51.0, 41.0], "bbox": [41, 31, 61, 51], "area": 150.0, "score": 0.75}
    seen = {"predicted": [50.5, 40.5], "similarity": 0.95, "learnt": True}
    rows = [
        record(9),
        record(10, target(7, "tentative", provenance={"detection": match, "cause": "began on a detection"})),
        record(
            11,
            target(7, "confirmed", provenance={"detection": {**match, "gate": 1.5}, "cause": "confirmed"}),
        ),
        record(12, target(7, "confirmed", provenance={**seen, "detection": {**match, "gate": 0.5}})),
        record(13, target(7, "coasting", provenance={"predicted": [52.0, 42.0], "similarity": 0.55})),
        record(14, target(7, "lost", provenance={"predicted": [53.0, 43.0], "cause": "left the frame"})),
    ]
    path.write_text("".join(rows))
    return path


def test_a_moment_is_explained(tmp_path: Path) -> None:
    """Detection, distance, similarity, registration, and what had been decided until then and after."""
    result = run(life(tmp_path / "t.jsonl"), "7@0.48")
    assert result.exit_code == 0
    for part in (
        "track 7 at 0.480 s: frame 12, epoch 0",
        "ok, plane 3, 180 of 200 points agree, rmse 0.25 px",
        "50.5 40.5 px",
        "row 2 at 51.0 41.0 px, 0.50 deviations away (gate 4)",
        "0.950 to its template; learnt from this frame",
        "frame 10, 0.400 s: tentative: began on a detection",
        "detected in 3 of 3 frames",
        "distance of its detections: median 1.00, largest 1.50",
        "frame 14, 0.560 s: lost: left the frame",
    ):
        assert part in result.stdout


def test_a_rule_that_keeps_a_region_waiting_is_listed_once(tmp_path: Path) -> None:
    """With its last numbers, however many frames it takes."""
    path, causes = tmp_path / "t.jsonl", [f"waits, faint: mean score 0.{index}" for index in range(10, 20)]
    causes = ["began on a detection", *causes, "waits, hardly moved: 1.0 px", "confirmed"]
    states = ["tentative"] * 12 + ["confirmed"]
    rows = [
        record(seq, target(7, state, provenance={"cause": cause}))
        for seq, (state, cause) in enumerate(zip(states, causes, strict=True))
    ]
    path.write_text("".join(rows))
    listed = [
        line.split(": ", 1)[1] for line in run(path, "7").stdout.splitlines() if line.startswith("  frame ")
    ]
    assert listed == [
        "tentative: began on a detection",
        "tentative: waits, faint: mean score 0.19",
        "tentative: waits, hardly moved: 1.0 px",
        "confirmed",
    ]


@pytest.mark.parametrize(
    ("moment", "reason"), [("7#11", "its detection is enough in this frame"), ("7#14", "it was not searched")]
)
def test_a_look_that_was_not_compared_has_a_reason(tmp_path: Path, moment: str, reason: str) -> None:
    """A detected target is searched in every other frame, one that left the frame not at all."""
    assert f"similarity   not compared: {reason}" in run(life(tmp_path / "t.jsonl"), moment).stdout


def test_the_standard_input_is_read(tmp_path: Path) -> None:
    """As `tracks -` and `convert -` do, so that records come from a pipe."""
    command = [sys.executable, "-m", "streamkit", "explain", "-", "7@0.48"]
    lines = life(tmp_path / "t.jsonl").read_bytes()
    done = subprocess.run(command, input=lines, capture_output=True, timeout=60, check=False)
    assert done.returncode == 0
    assert done.stdout.decode() == run(tmp_path / "t.jsonl", "7@0.48").output


def test_runs_appended_to_a_file_are_kept_apart(tmp_path: Path) -> None:
    """As by if-exists=continue: numbers of frames and tracks begin again."""
    path = life(tmp_path / "t.jsonl")
    first = path.read_text()
    path.write_text(first + record(12) + record(13, target(8, "confirmed")) + first)
    last = run(path, "7#12")
    assert last.stderr.startswith(f"note: {path} has 3 runs, this is run 3")
    assert last.stdout == run(life(tmp_path / "one.jsonl"), "7#12").stdout
    assert run(path, "8#13").stderr.endswith("this is run 2; see --run\n")
    absent = run(path, "7#12", "--run", 2)
    assert (absent.exit_code, absent.stderr) == (
        1,
        f"error: {path}: no track 7 in 2 records; confirmed were 8\n",
    )
    assert run(path, "7#12", "--run", 4).stderr == f"error: {path}: no run 4, it has 3\n"


def test_a_frame_without_a_detection_says_so(tmp_path: Path) -> None:
    """By its number; the stretch without a detection is named."""
    result = run(life(tmp_path / "t.jsonl"), "7#13")
    assert "detection    none in its gate" in result.stdout
    assert "not detected in frames 13" in result.stdout
    assert "0.550 to its template; not learnt from this frame" in result.stdout


def test_json_has_the_same(tmp_path: Path) -> None:
    """For programs."""
    found = json.loads(run(life(tmp_path / "t.jsonl"), "7@0.5", "--json").stdout)
    assert (found["track"], found["moment"]["frame"]) == (7, 12)
    assert found["moment"]["match"]["score"] == 0.75
    assert (found["life"]["detected"], found["life"]["gates"]) == (3, [1.0, 1.5])


def test_seconds_are_those_of_an_epoch(tmp_path: Path) -> None:
    """The first epoch in which the track is there then, or the one asked for."""
    path = tmp_path / "t.jsonl"
    rows = [
        record(seq, target(1, "confirmed"), epoch=seq // 5, pts_ns=seq % 5 * STEP_NS) for seq in range(10)
    ]
    path.write_text("".join(rows))
    assert "frame 2, epoch 0" in run(path, "1@0.08").stdout
    assert "frame 7, epoch 1" in run(path, "1@0.08", "--epoch", 1).stdout


def test_records_without_provenance_are_explained_as_far_as_they_go(tmp_path: Path) -> None:
    """As those from zenoh; how to get the rest is said."""
    path = tmp_path / "t.jsonl"
    path.write_text(record(0, target(1, "confirmed")) + record(1, target(1, "confirmed")))
    result = run(path, "1@0.04")
    assert result.exit_code == 0
    assert "write it with tracksink provenance=true" in result.stdout
    assert "not detected" not in result.stdout


@pytest.mark.parametrize(
    ("question", "code", "error"),
    [
        ("7@", 2, "must be ID@SECONDS or ID#FRAME"),
        ("7@soon", 2, "must be ID@SECONDS or ID#FRAME"),
        ("x@1", 2, "must be ID@SECONDS or ID#FRAME"),
        ("7@nan", 2, "must be ID@SECONDS or ID#FRAME"),
        ("7@0.9", 1, "it is from 0.400 s to 0.560 s (frames 10 to 14"),
        ("8@0.4", 1, "no track 8 in 6 records; confirmed were 7"),
    ],
)
def test_a_missing_target_or_frame_is_reported(tmp_path: Path, question: str, code: int, error: str) -> None:
    """With what could be asked instead."""
    result = run(life(tmp_path / "t.jsonl"), question)
    assert result.exit_code == code
    assert error in result.stderr


def test_a_line_that_is_no_record_is_reported(tmp_path: Path) -> None:
    """File and line; but the half last line of a process that was killed is left out."""
    path = tmp_path / "t.jsonl"
    path.write_text(record(0, target(1, "confirmed")) + "hello\n" + record(1))
    result = run(path, "1@0")
    assert result.exit_code == 1
    assert "t.jsonl:2: not a track record" in result.stderr
    path.write_text(record(0, target(1, "confirmed")) + record(1)[:40])
    result = run(path, "1@0")
    assert result.exit_code == 0
    assert "only half written" in result.stderr


def touch(first: list[float], second: list[float]) -> bool:
    """Whether two boxes x0 y0 x1 y1 have something in common."""
    return all(first[i] <= second[i + 2] and second[i] <= first[i + 2] for i in (0, 1))


def test_every_row_of_a_real_run_is_explained(tmp_path: Path) -> None:
    """Each begins on a detection, each detection lies in the gate or upon the target, losses have causes."""
    path = tmp_path / "tracks.jsonl"
    text = (
        "dronetestsrc num-buffers=45 seed=4 cars=6 ! video/x-raw, width=480, height=360 "
        f"! stitch ! framediff ! particletrack ! tracksink location={path}"
    )
    Pipeline.parse(text).run(timeout_s=60)
    rows = [
        (line["seq"], row)
        for line in map(json.loads, path.read_text().splitlines())
        for row in line["tracks"]
    ]
    began = {row["id"]: row for _, row in reversed(rows)}
    assert began
    for row in began.values():
        assert row["provenance"]["cause"] == "began on a detection"
        assert row["provenance"]["detection"]["centroid"] == pytest.approx([row["x"], row["y"]])
    confirmed = {row["id"] for _, row in rows if row["provenance"].get("cause") == "confirmed"}
    assert confirmed == {row["id"] for _, row in rows if row["state"] == "confirmed"}
    assert confirmed
    for seq, row in rows:
        origin = row["provenance"]
        match = origin.get("detection", {})
        assert match.get("gate", 0.0) <= 4.0 or touch(match["bbox"], row["bbox"])
        assert row["state"] != "lost" or origin["cause"]
        if row["state"] == "confirmed":
            result = run(path, f"{row['id']}#{seq}")
            assert result.exit_code == 0
            assert "began on a detection" in result.stdout
            break


def test_the_gate_is_that_of_the_tracker() -> None:
    """Which has it squared."""
    assert associate.GATE == GATE**2
