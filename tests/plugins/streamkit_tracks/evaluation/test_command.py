"""`streamkit trackeval` on files."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from streamkit_tracks.evaluation.command import trackeval


def run(*words: object) -> Result:
    """The command, run in this process."""
    app = typer.Typer()
    app.command()(trackeval)
    return CliRunner().invoke(app, [str(word) for word in words])


def record(seq: int, *tracks: tuple[int, str, list[float]]) -> str:
    """A line of tracksink."""
    unused = {"x": 0, "y": 0, "length": 0, "width": 0, "angle": 0, "score": 1, "age_ns": 0}
    rows = [unused | {"id": number, "state": state, "bbox": bbox} for number, state, bbox in tracks]
    frame = {"schema": "streamkit.tracks/1", "source": "t", "epoch": 0, "seq": seq, "dropped": 0}
    return json.dumps(frame | {"tracks": rows}) + "\n"


def test_tracks_of_many_are_scored(tmp_path: Path):
    """JSON lines against MOT text; tentative and lost tracks and unused truths do not count."""
    box = [-0.5, -0.5, 9.5, 9.5]
    tracks, truth = tmp_path / "tracks.jsonl", tmp_path / "gt.txt"
    tracks.write_text(
        record(0, (4, "confirmed", box), (5, "tentative", box))
        + record(1, (4, "coasting", box), (6, "lost", box))
    )
    truth.write_text("1,1,1,1,10,10,1,-1,-1,-1\n2,1,1,1,10,10,1,-1,-1,-1\n2,2,90,1,10,10,0,-1,-1,-1\n")
    scores = json.loads(run(tracks, truth, "--json").stdout)
    assert (scores["mota"], scores["idf1"], scores["truths"], scores["overlap"]) == (1.0, 1.0, 2, 1.0)


@pytest.mark.parametrize(
    ("first", "second", "code", "words"),
    [
        ("1,1,1,1,10,10,1,-1,-1,-1", "1,1,1,1,10,10,0.87,-1,-1,-1", 0, "has the score 0.87 in column 7"),
        ("1,1,1,1,10,10,1,1,0.5", "1,1,1,1,10,10,1,-1,-1,-1", 0, "has nine columns"),
        ("1,1,10,10", "1,1,1,1,10,10,1,-1,-1,-1", 1, "needs 6 numbers or more"),
        ("1,1,1,1,10,10,1,-1,-1,-1", '{"schema":', 1, "needs 4 numbers or more"),
        ("1,1,1,1,10,10,1,-1,-1,-1", "source,seq", 1, "gt.txt truth.txt; tracks come first"),
    ],
)
def test_truth_in_the_place_of_tracks_is_noticed(
    tmp_path: Path, first: str, second: str, code: int, words: str
):
    """By what only one of them holds; the files are scored as they are given, where they can be."""
    tracks, truth = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    tracks.write_text(first + "\n")
    truth.write_text(second + "\n")
    result = run(tracks, truth)
    assert (result.exit_code, words in result.stderr) == (code, True)
    assert result.stderr.endswith("tracks come first, ground truth second\n")
    truth.write_text("1,1,1,1,10,10,1,-1,-1,-1\n")
    tracks.write_text("1,1,1,1,10,10,0.87,-1,-1,-1\n")
    assert run(tracks, truth).stderr == ""


def test_one_run_of_several_is_scored(tmp_path: Path):
    """The last without --run, and the command says so; a half-written last line is left out."""
    hit, miss = [-0.5, -0.5, 9.5, 9.5], [40.0, 40.0, 50.0, 50.0]
    tracks, truth = tmp_path / "tracks.jsonl", tmp_path / "gt.txt"
    first = record(0, (1, "confirmed", miss)) + record(1, (1, "confirmed", miss))
    tracks.write_text(first + record(0, (1, "confirmed", hit)) + '{"schema"')
    truth.write_text("1,1,1,1,10,10,1,-1,-1,-1\n")
    result = run(tracks, truth, "--json")
    assert json.loads(result.stdout)["idf1"] == 1.0
    assert "has 2 runs, this is run 2" in result.stderr
    assert "only half written" in result.stderr
    assert json.loads(run(tracks, truth, "--json", "--run", "1").stdout)["idf1"] == 0.0
    assert "no run 3, it has 2" in run(tracks, truth, "--run", "3").stderr


def test_a_csv_file_is_scored_like_its_records(tmp_path: Path):
    """As tracksink writes it; its boxes are those of the records."""
    tracks, truth = tmp_path / "tracks.csv", tmp_path / "gt.txt"
    tracks.write_text(
        "source,seq,id,state,x0,y0,x1,y1\nf,0,4,confirmed,-0.5,-0.5,9.5,9.5\nf,0,5,tentative,-0.5,-0.5,9.5,9.5\n"
    )
    truth.write_text("1,1,1,1,10,10,1,-1,-1,-1\n")
    scores = json.loads(run(tracks, truth, "--json").stdout)
    assert (scores["mota"], scores["idf1"], scores["truths"], scores["overlap"]) == (1.0, 1.0, 1, 1.0)


def test_one_target_is_scored_in_one_pass(tmp_path: Path):
    """Four columns are one target's truth; the track that is there longest is its track."""
    tracks, truth = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    tracks.write_text("1,3,0,0,10,10,1,-1,-1,-1\n2,3,0,0,10,10,1,-1,-1,-1\n2,8,50,0,10,10,1,-1,-1,-1\n")
    truth.write_text("0,0,10,10\n0\t0 10 10\n")
    result = run(tracks, truth)
    assert result.exit_code == 0
    assert "success              0.952" in result.stdout
    assert "precision            1.000" in result.stdout


@pytest.mark.parametrize(("first", "left"), [(1, 21), (0, 20)])
def test_the_same_box_is_the_same_however_pixels_are_counted(tmp_path: Path, first: int, left: int):
    """Published truths count pixels from 1; a target of 4 px would lose half its overlap by that."""
    tracks, truth = tmp_path / "tracks.jsonl", tmp_path / "gt.txt"
    tracks.write_text(record(0, (4, "confirmed", [19.5, 19.5, 23.5, 23.5])))
    truth.write_text(f"{left},{left},4,4\n")
    scores = json.loads(run(tracks, truth, "--json", "--first-pixel", first).stdout)
    assert scores["centre_error"] == 0.0
    assert scores["success"] == pytest.approx(20 / 21)


@pytest.mark.parametrize(
    ("name", "text", "error"),
    [
        ("tracks.txt", "1,2,3\n", "tracks.txt:1: needs 6 numbers or more"),
        ("tracks.txt", "0,1,2,3,4,5\n", "tracks.txt:1: frames count from 1"),
        ("tracks.jsonl", '{"seq": 1}\n', "tracks.jsonl:1: "),
        ("tracks.jsonl", "hello\n", "tracks.jsonl:1: "),
        ("tracks.csv", "seq,id\n1,2\n", "tracks.csv:2: not a row of tracks"),
        ("det.txt", 3 * "2,-1,1,1,9,9,1\n", "det.txt: frame 2 has id -1 3 times; give the tracks of one run"),
    ],
)
def test_an_error_names_the_line_that_is_no_track(tmp_path: Path, name: str, text: str, error: str):
    """Exit code 1, the file, the line and the rule."""
    tracks, truth = tmp_path / name, tmp_path / "gt.txt"
    tracks.write_text(text)
    truth.write_text("0,0,10,10\n")
    result = run(tracks, truth)
    assert result.exit_code == 1
    assert error in result.stderr


def test_a_video_is_refused_as_the_wrong_file(tmp_path: Path):
    """What is no text names the file all the same."""
    video, boxes = tmp_path / "flight.mp4", tmp_path / "boxes.txt"
    video.write_bytes(bytes(range(256)))
    boxes.write_text("1,2,0,0,10,10\n")
    assert "flight.mp4:1: " in run(video, boxes).stderr
    assert "flight.mp4:1: needs 4 numbers or more" in run(boxes, video).stderr


def test_frames_without_truth_are_left_out(tmp_path: Path):
    """Tracks behind the last frame of the truth are neither right nor wrong; --frames narrows further."""
    box = [-0.5, -0.5, 9.5, 9.5]
    tracks, truth = tmp_path / "tracks.jsonl", tmp_path / "gt.txt"
    tracks.write_text("".join(record(seq, (4, "confirmed", box)) for seq in range(5)))
    truth.write_text("2,1,1,1,10,10,1\n3,1,50,1,10,10,1\n")
    result = run(tracks, truth, "--json")
    assert (
        result.stderr == "note: the tracks go on to frame 5, the truth ends with 3: the rest is not scored\n"
    )
    scores = json.loads(result.stdout)
    assert (scores["frames"], scores["misses"], scores["false_alarms"]) == (2, 1, 1)
    scores = json.loads(run(tracks, truth, "--json", "--frames", "2:2").stdout)
    assert (scores["frames"], scores["mota"], scores["hota"]) == (1, 1.0, 1.0)
    result = run(tracks, truth, "--frames", "500:600")
    assert result.exit_code == 1
    assert "the truth has no box there" in result.stderr


def test_frames_narrow_one_target_too(tmp_path: Path):
    """The first frame of two is wrong and left out."""
    tracks, truth = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    tracks.write_text("1,3,90,90,10,10,1\n2,3,1,1,10,10,1\n")
    truth.write_text("1,1,10,10\n1,1,10,10\n")
    assert json.loads(run(tracks, truth, "--json", "--frames", "2:2").stdout)["precision"] == 1.0


@pytest.mark.parametrize("text", ["5", "0:4", "4:2", "a:b", "1:2:3", "-1:2"])
def test_a_wrong_range_of_frames_is_refused(tmp_path: Path, text: str):
    """With an example."""
    tracks, truth = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    tracks.write_text("1,3,1,1,10,10,1\n")
    truth.write_text("1,1,1,1,10,10,1\n")
    result = run(tracks, truth, f"--frames={text}")
    assert result.exit_code == 2
    assert "--frames" in result.stderr


def test_tracks_of_distractors_do_not_count(tmp_path: Path):
    """From MOT16 on the truth has classes: a reflection (12) is neither to be found nor to be left out."""
    tracks, truth = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    tracks.write_text("1,3,1,1,10,10,1\n1,4,50,1,10,10,1\n1,5,90,1,10,10,1\n")
    truth.write_text("1,1,1,1,10,10,1,1,1.0\n1,2,50,1,10,10,0,12,1.0\n1,3,90,1,10,10,0,9,1.0\n")
    scores = json.loads(run(tracks, truth, "--json").stdout)
    assert (scores["truths"], scores["misses"], scores["false_alarms"]) == (1, 0, 1)


@pytest.mark.parametrize(
    ("tracks", "truth", "words"),
    [
        ("", "1,1,1,1,10,10,1", "there is no track in the whole file"),
        ("9,1,1,1,10,10,1", "1,1,1,1,10,10,1", "the tracks are in frames 9 to 9, scored are 1 to 1"),
        ("1,1,90,1,10,10,1", "1,1,1,1,10,10,1", "are both of the same video"),
        ("", "1,1,10,10", "there is no track in the whole file"),
        ("1,1,90,1,10,10,1", "1,1,10,10", "are both of the same video"),
    ],
)
def test_zeros_come_with_their_reason(tmp_path: Path, tracks: str, truth: str, words: str):
    """Nothing matched: an empty file, frames or pixels that do not fit; none where something has."""
    found, true = tmp_path / "tracks.txt", tmp_path / "gt.txt"
    found.write_text(tracks)
    true.write_text(truth)
    result = run(found, true)
    assert result.exit_code == 0
    assert f"note: no track matches the truth: {words}" in result.stderr
    found.write_text("1,1,1,1,10,10,1")
    assert run(found, true).stderr == ""
