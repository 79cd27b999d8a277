"""`streamkit report`: the page of a finished run shows its targets, and loads nothing."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from streamkit import Pipeline
from streamkit_tracks.report.command import index_at
from tests import command_line
from tests.slowness import patience

BINARY = str(Path(sys.executable).with_name("streamkit"))
pytestmark = pytest.mark.timeout(240)


def report(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs the command."""
    return command_line.run("report", *arguments)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Records of one drawn target, and the video that they are of."""
    folder = tmp_path_factory.mktemp("run")
    records, video = folder / "<b>tracks.jsonl", folder / "flight.mp4"
    pipeline = Pipeline.parse(
        "dronetestsrc num-buffers=20 cars=1 ! video/x-raw, format=I420, width=320, height=240, "
        f"framerate=25/1 ! tee name=t  t. ! queue ! videofilesink location={video} "
        "t. ! queue ! particletrack window=100,80,40,30 ! tracksink name=records"
    )
    pipeline["records"].location = str(records)
    pipeline.run(timeout_s=patience(150))
    return records, video


def test_the_page_shows_the_run(run: tuple[Path, Path], tmp_path: Path) -> None:
    """Figures, pictures and the table; text of the file is text, and every image is in the page."""
    records, video = run
    page = tmp_path / "page.html"
    done = report(records, "--video", video, "-o", page)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"wrote {page}\n")
    text = page.read_text()
    assert "&lt;b&gt;tracks.jsonl" in text
    assert "<b>" not in text
    assert re.findall("<h2>(.*?)</h2>", text) == [
        "Map", "Targets over time", "Number of targets", "Targets",
    ]  # fmt: skip
    sources = re.findall('src="([^,]*),', text)
    assert sources == ["data:image/jpeg;base64", *["data:image/svg+xml;base64"] * 3, "data:image/jpeg;base64"]
    assert "<td>1</td><td>0.00</td><td>0.76</td><td>20</td>" in text
    assert re.search(r'(?:src|href)="(?!data:)', text) is None


def test_targets_without_a_frame_of_their_time_are_counted(run: tuple[Path, Path], tmp_path: Path) -> None:
    """Such as those of a run behind videorate; the page is made, with the pictures that there are."""
    records, video = run
    first, *others = map(json.loads, records.read_text().splitlines())
    moved = {**first, "pts_ns": first["pts_ns"] + 7_000_000}  # the target is largest there
    path = tmp_path / "rated.jsonl"
    path.write_text("".join(json.dumps(record) + "\n" for record in (moved, *others)))
    done = report(path, "--video", video, "-o", tmp_path / "page.html")
    assert done.returncode == 0
    assert done.stderr.startswith(f"note: targets without a picture: 1; no frame of {video} has")


def test_a_run_that_begins_late_in_its_stream_says_when(run: tuple[Path, Path], tmp_path: Path) -> None:
    """`tracks` and `explain` have the times of the stream, the page those from the first frame."""
    later, page = tmp_path / "later.jsonl", tmp_path / "page.html"
    lines = [json.loads(line) for line in run[0].read_text().splitlines()]
    later.write_text(
        "".join(json.dumps(line | {"pts_ns": line["pts_ns"] + 2 * 10**9}) + "\n" for line in lines)
    )
    assert report(later, "-o", page).returncode == 0
    assert "in 0.8 s, from 2.00 s of the stream on, where times here begin, 1 confirmed" in page.read_text()
    assert report(run[0], "-o", page).returncode == 0
    assert "in 0.8 s, 1 confirmed" in page.read_text()


def test_runs_that_alternate_are_kept_apart(run: tuple[Path, Path], tmp_path: Path) -> None:
    """The records of two publishers, one by one: each run has its own."""
    both, page = tmp_path / "both.jsonl", tmp_path / "page.html"
    lines = run[0].read_text().splitlines()
    other = [json.dumps(json.loads(line) | {"source": "other"}) for line in lines[:10]]
    both.write_text("".join(f"{one}\n{two}\n" for one, two in zip(lines[:10], other, strict=True)))
    for arguments in ((), ("--run", "2")):
        done = report(both, "-o", page, *arguments)
        assert done.returncode == 0, done.stderr
        assert "Source other: 10 frames of" in page.read_text()
    for command in (["tracks", both], ["explain", both, "1"]):
        done = command_line.run(*command)
        assert done.returncode == 0, done.stderr
        assert re.search("2 targets, 2 confirmed|has 2 runs, this is run 2", done.stderr)


def test_a_full_disk_is_reported_with_the_page(run: tuple[Path, Path], tmp_path: Path) -> None:
    """`/dev/full` refuses every write."""
    page = tmp_path / "page.html"
    page.symlink_to("/dev/full")
    done = report(run[0], "-o", page)
    error = f"error: {page}: cannot be written: No space left on device; free some space\n"
    assert (done.returncode, done.stderr) == (1, error)


def test_without_a_video_there_are_figures_only(run: tuple[Path, Path], tmp_path: Path) -> None:
    """The same records give the same page."""
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page in pages:
        assert report(run[0], "-o", page).returncode == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()
    assert "image/jpeg" not in pages[0].read_text()


def test_what_does_not_belong_together_is_an_error(run: tuple[Path, Path], tmp_path: Path) -> None:
    """Another video, a run that is not there, a page that cannot be written."""
    records, flight = run
    other = flight.with_name("other.mp4")
    text = "videotestsrc num-buffers=2 ! video/x-raw, width=64, height=48 ! videofilesink location={}"
    Pipeline.parse(text.format(other)).run(timeout_s=patience(60))
    done = report(records, "--video", other, "-o", tmp_path / "x.html")
    assert done.returncode == 1
    assert "the tracks are of frames of 320 x 240 px; give their own video" in done.stderr
    done = report(records, "--run", 3, "-o", tmp_path / "x.html")
    assert (done.returncode, "no run 3, it has 1" in done.stderr) == (1, True)
    done = report(records, "-o", tmp_path / "x.pdf")
    assert (done.returncode, "must end in .html" in done.stderr) == (2, True)
    assert list(tmp_path.iterdir()) == []
    done = report(records, "--stats", tmp_path / "nope.json", "-o", tmp_path / "x.html")
    assert (done.returncode, done.stderr) == (
        1, f"error: {tmp_path / 'nope.json'}: No such file or directory; check the path\n"
    )  # fmt: skip
    empty = tmp_path / "empty.jsonl"
    empty.touch()
    assert "empty.jsonl: no record in it" in report(empty, "-o", tmp_path / "x.html").stderr
    done = report(records, "-o", empty / "x.html")
    assert (done.returncode, "empty.jsonl" in done.stderr) == (1, True)
    assert list(tmp_path.iterdir()) == [empty]


def test_missing_folders_are_made(run: tuple[Path, Path], tmp_path: Path) -> None:
    """As for every other output."""
    page = tmp_path / "new" / "page.html"
    assert report(run[0], "-o", page).returncode == 0
    assert page.exists()


def test_the_cost_of_each_element(run: tuple[Path, Path], tmp_path: Path) -> None:
    """From the counters of a run, the costliest first and without queues; another file is refused."""
    stats, page = tmp_path / "stats.json", tmp_path / "page.html"
    text = "videotestsrc num-buffers=5 ! queue ! identity name=<slow> sleep-time=20000 ! fakesink"
    subprocess.run([BINARY, "launch", text, "--stats-file", stats], check=True, timeout=patience(60))
    assert report(run[0], "--stats", stats, "-o", page).returncode == 0
    rows = re.findall("<tr>((?:<td>[^<]*</td>){5})</tr>", page.read_text())
    cells = [re.findall("<td>(.*?)</td>", row) for row in rows]
    assert cells[0][4] == "&lt;slow&gt;"
    assert {row[4] for row in cells} == {"&lt;slow&gt;", "videotestsrc0", "fakesink0"}
    assert float(cells[0][1]) > 19
    done = report(run[0], "--stats", run[1], "-o", page)
    assert done.returncode == 1
    assert "launch --stats-file" in done.stderr


def test_times_are_matched_to_the_millisecond_of_matroska() -> None:
    """A frame a tenth of a second from any record belongs to none."""
    times = [(round(number * 1e9 / 30), number) for number in range(5)]
    assert [index_at(times, ms * 1_000_000) for ms in (0, 33, 67, 100, 133)] == [0, 1, 2, 3, 4]
    assert [index_at(times, ms * 1_000_000) for ms in (-1, 34, 50, 233)] == [None] * 4
    assert index_at(times, None) is None


def test_frames_that_a_queue_dropped_are_told(run: tuple[Path, Path], tmp_path: Path) -> None:
    """In the totals and in the figure of losses, which a run without losses does not have."""
    whole, page = run[0].read_text().splitlines(), tmp_path / "report.html"
    assert report(run[0], "-o", page).returncode == 0
    assert "have no record" not in page.read_text()
    part = tmp_path / "part.jsonl"
    part.write_text("\n".join([*whole[:3], *whole[5:]]))
    assert report(part, "-o", page).returncode == 0
    assert "(2 more have no record)" in page.read_text()
    assert "Age and losses" in page.read_text()
