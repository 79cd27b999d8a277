"""`streamkit tracks` and `streamkit convert` on the file of a finished run."""

import io
import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

from streamkit import Pipeline, RecordFile, TrackState
from streamkit_tracks.command import TargetSummary, list_targets, table_lines
from streamkit_tracks.recorded_runs import MISSING
from tests.command_line import run
from tests.slowness import patience

BINARY = str(Path(sys.executable).with_name("streamkit"))


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of one target that was drawn by hand."""
    path = tmp_path_factory.mktemp("run") / "tracks.jsonl"
    text = (
        "videotestsrc num-buffers=20 ! video/x-raw, width=320, height=240, framerate=25/1 "
        f"! particletrack window=100,80,40,30 ! tracksink location={path}"
    )
    Pipeline.parse(text).run(timeout_s=patience(120))
    return path


@pytest.mark.timeout(200)
def test_targets_are_listed(records: Path) -> None:
    """A line each: id, times, frames, size, states; as JSON the same."""
    done = run("tracks", str(records))
    assert (done.returncode, done.stderr) == (0, "1 target, 1 confirmed\n")
    head, line = done.stdout.splitlines()
    states = ["tentative", "confirmed", "coasting", "lost"]
    assert head.split() == ["id", "from", "s", "to", "s", "frames", "size", "px", *states]
    assert line.split()[:4] == ["1", "0.00", "0.76", "20"]
    assert sum(map(int, line.split()[5:])) == 20
    (row,) = [json.loads(line) for line in run("tracks", "--json", str(records)).stdout.splitlines()]
    assert (row["run"], row["id"], row["first_s"], row["last_s"]) == (1, 1, 0.0, 0.76)
    assert sum(row["states"].values()) == 20


def test_a_target_ends_with_the_last_frame_in_which_it_was_there(tmp_path: Path) -> None:
    """Not with the one that tells of its loss, which after an interruption of the feed comes much later."""
    path = tmp_path / "tracks.jsonl"
    target = {"id": 1, "x": 0, "y": 0, "length": 9, "width": 5, "angle": 0, "bbox": [0, 0, 9, 5]}
    target |= {"score": 1, "age_ns": 0}
    frame = {"schema": "streamkit.tracks/1", "source": "t", "epoch": 0, "dropped": 0}
    rows = [(0, 0.0, "confirmed"), (1, 0.04, "coasting"), (2, 25.0, "lost")]
    path.write_text(
        "".join(
            json.dumps(
                frame | {"seq": seq, "pts_ns": round(time_s * 1e9), "tracks": [target | {"state": state}]}
            )
            + "\n"
            for seq, time_s, state in rows
        )
    )
    (row,) = list_targets(RecordFile(path))
    assert (row.first_s, row.last_s, row.states["lost"]) == (0.0, 0.04, 1)


def test_the_table_fits_80_columns() -> None:
    """With several runs, hours of frames in every state, and a large target."""
    states = Counter({state.value: 1234 for state in TrackState})
    target = TargetSummary(12, 1234, 0.0, 86400.0, states, length_px=131.2, width_px=114.8)
    head, line = table_lines([target])
    assert len(head) == len(line) == 80
    assert line.split() == ["12", "1234", "0.00", "86400.00", "4936", "131.2x114.8", *4 * ["1234"]]


@pytest.mark.timeout(200)
def test_runs_are_told_apart(records: Path, tmp_path: Path) -> None:
    """Where a file has several, each line begins with the number of its run; a cut line is noted."""
    both = tmp_path / "both.jsonl"
    both.write_bytes(2 * records.read_bytes() + b'{"schema":')
    done = run("tracks", str(both))
    assert done.returncode == 0
    assert "only half written" in done.stderr
    assert [line.split()[:2] for line in done.stdout.splitlines()[1:]] == [["1", "1"], ["2", "1"]]
    both.write_bytes(2 * records.read_bytes())
    written = tmp_path / "out.txt"
    done = run("convert", str(both), str(written))
    assert done.stderr == f"note: {both} has 2 runs, this is run 2; see --run\n"
    assert len(written.read_text().splitlines()) == 20
    assert run("convert", str(both), str(written), "--run", "1").stderr == ""
    assert len(written.read_text().splitlines()) == 20
    assert "no run 3, it has 2" in run("convert", str(both), str(written), "--run", "3").stderr
    both.write_bytes(b"")
    done = run("convert", str(both), str(written))
    assert (done.returncode, done.stderr) == (1, f"error: {both}: no record in it\n")


@pytest.mark.timeout(200)
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("out.csv", "tracks,0,0"),
        ("out.txt", "1,1,"),
        ("out.mcap", "MCAP"),
        ("out.parquet", "PAR1"),
        ("out.jsonl", "{"),
    ],
)
def test_records_are_converted_by_suffix(records: Path, tmp_path: Path, name: str, words: str) -> None:
    """The file is what the sink makes of it."""
    done = run("convert", str(records), str(tmp_path / name))
    assert (done.returncode, done.stderr) == (0, "")
    assert words in (tmp_path / name).read_bytes().decode("latin-1")


@pytest.mark.timeout(200)
def test_unknown_times_are_null_in_parquet(records: Path, tmp_path: Path) -> None:
    """And known ones are those of the record."""
    parquet = pytest.importorskip("pyarrow.parquet")
    assert run("convert", str(records), str(tmp_path / "out.parquet")).returncode == 0
    table = parquet.read_table(tmp_path / "out.parquet").to_pydict()
    expected = [json.loads(line) for line in records.read_text().splitlines()]
    assert table["pts_ns"] == [record["pts_ns"] for record in expected for _ in record["tracks"]]
    assert set(table["capture_ns"]) == {None}


@pytest.mark.timeout(200)
def test_a_full_disk_is_reported_with_the_file(records: Path) -> None:
    """`/dev/full` refuses every write."""
    done = run("convert", str(records), "/dev/full", "--format", "parquet")
    error = "error: /dev/full: cannot be written: No space left on device; free some space\n"
    assert (done.returncode, done.stderr) == (1, error)


@pytest.mark.timeout(200)
def test_records_are_converted_to_standard_output(records: Path, tmp_path: Path) -> None:
    """As JSON lines, or in the format given; the same bytes as in a file."""

    def convert(*options: str) -> subprocess.CompletedProcess[str]:
        """In a process, whose standard output becomes that of the file."""
        command = [BINARY, "convert", str(records), "-", *options]
        return subprocess.run(command, capture_output=True, text=True, timeout=patience(30), check=False)

    done = convert()
    assert (done.returncode, done.stderr) == (0, "")
    assert len([json.loads(line) for line in done.stdout.splitlines()]) == 20
    for form, name in (("csv", "out.csv"), ("mot", "out.txt")):
        assert run("convert", str(records), str(tmp_path / name)).returncode == 0
        done = convert("--format", form)
        assert (done.returncode, done.stderr, done.stdout) == (0, "", (tmp_path / name).read_text())


def test_mcap_is_written_to_a_pipe(records: Path) -> None:
    """Its index has positions, which a pipe does not tell."""
    command = [sys.executable, "-m", "streamkit", "convert", str(records), "-", "--format", "mcap"]
    done = subprocess.run(command, capture_output=True, timeout=100, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    messages = list(make_reader(io.BytesIO(done.stdout)).iter_messages())
    assert len(messages) == 20


@pytest.mark.timeout(200)
def test_what_a_format_lacks_is_said(records: Path, tmp_path: Path) -> None:
    """No positions for KML, no such format, no record."""
    done = run("convert", str(records), str(tmp_path / "out.kml"))
    assert done.returncode == 0
    assert "no target in 20 records has a position" in done.stderr
    refused = run("convert", str(records), str(tmp_path / "out.xyz"))
    assert refused.returncode == 1
    endings = ".jsonl, .txt, .csv, .geojson, .kml, .cot, .mcap, .parquet"
    assert f"the name must end in {endings}, it ends in '.xyz'; or give --format" in refused.stderr
    for command in (["tracks", __file__], ["convert", __file__, str(tmp_path / "out.csv")]):
        refused = run(*command)
        assert refused.returncode == 1
        assert "not a track record" in refused.stderr
        assert len(refused.stderr.splitlines()) == 1


@pytest.mark.timeout(200)
def test_csv_and_mot_text_are_converted_back(records: Path, tmp_path: Path) -> None:
    """With a note of what they lack; a format that cannot be read is an error that names those that can."""
    table, lines = tmp_path / "out.csv", tmp_path / "out.jsonl"
    assert run("convert", str(records), str(table)).returncode == 0
    done = run("convert", str(table), str(lines))
    assert (done.returncode, done.stderr) == (0, f"note: {table}: {MISSING['.csv']}\n")
    found, wanted = (json.loads(file.read_text().splitlines()[5]) for file in (lines, records))
    assert [target["x"] for target in found["tracks"]] == [target["x"] for target in wanted["tracks"]]
    (tmp_path / "out.kml").touch()
    done = run("convert", str(tmp_path / "out.kml"), str(lines))
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith("out.kml: .kml cannot be read; give one of .jsonl, .csv, .txt\n")


LINE = (
    '{{"schema":"streamkit.tracks/1","source":"a","seq":{0},"epoch":0,"dropped":0,"tracks":[{{"id":{0},'
    '"state":"confirmed","x":1,"y":1,"length":5,"width":3,"angle":0,"bbox":[0,0,3,3],"score":1,"age_ns":5}}]}}\n'
)


def test_records_are_read_from_standard_input(tmp_path: Path) -> None:
    """As - of other tools."""
    lines = "".join(LINE.format(number) for number in range(3))
    out = tmp_path / "out.csv"
    for arguments in (("tracks", "-"), ("convert", "-", str(out))):
        done = run(*arguments, stdin=lines)
        assert done.returncode == 0, done.stderr
    assert len(out.read_text().splitlines()) == 4
    done = run("tracks", "-", stdin="no record")
    assert (done.returncode, "standard-input.jsonl:1" in done.stderr) == (1, True)


@pytest.mark.parametrize(
    "command",
    [("tracks", "{}", "--json"), ("convert", "{}", "-"), ("explain", "{}", "7", "--before", "9000")],
)
def test_a_reader_that_leaves_is_no_failure(tmp_path: Path, command: tuple[str, ...]) -> None:
    """As with head; the lines exceed what a pipe holds."""
    path = tmp_path / "tracks.jsonl"
    ids = re.compile('"id":[0-9]+') if command[0] == "explain" else re.compile("$^")
    path.write_text("".join(ids.sub('"id":7', LINE.format(number)) for number in range(3000)))
    with subprocess.Popen(
        [BINARY, *(word.format(path) for word in command)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        errors = process.stderr.read().decode()
        assert process.wait(patience(30)) == 0, errors
    assert "error" not in errors
    assert "Traceback" not in errors
