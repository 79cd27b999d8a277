"""The one line at the end of a run says what it has made."""

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from streamkit.cli.summary import RunSummary, as_text, dropped_text
from tests.slowness import patience

TRACKING = (
    "dronetestsrc num-buffers=30 seed=1 ! video/x-raw, width=320, height=240 "
    "! particletrack window=100,80,40,40 ! tee name=t ! tracksink location={0}/tracks.jsonl  "
    "t. ! queue ! jpegsink location={0}/image-%05d.jpg"
)


@pytest.mark.timeout(150)
def test_frames_tracks_and_files_as_json(launch: Callable[..., Result], tmp_path: Path) -> None:
    """One object on stdout; several files of one sink are named by their pattern."""
    done = launch("--summary", "json", TRACKING.format(tmp_path))
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found.pop("elapsed_s") > 0
    assert found == {
        "schema": "streamkit.summary/1",
        "frames": 30,
        "dropped": 0,
        "reasons": {},
        "results": {"tracks": 1},
        "files": {f"{tmp_path}/tracks.jsonl": 1, f"{tmp_path}/image-%05d.jpg": 30},
        "incomplete": [],
    }


def test_files_that_retention_has_deleted_are_counted(launch: Callable[..., Result], tmp_path: Path) -> None:
    """The first of those that were written are not there any more."""
    done = launch(
        "--summary", f"videotestsrc num-buffers=5 ! multifilesink location={tmp_path}/%d.raw max-files=2"
    )
    assert "3 deleted files, wrote 5 files" in done.stderr
    assert len(list(tmp_path.glob("*.raw"))) == 2


def test_text_is_one_line_on_stderr(launch: Callable[..., Result], tmp_path: Path) -> None:
    """Also if the run failed; stdout stays empty."""
    done = launch("--summary", f"videotestsrc num-buffers=4 ! filesink location={tmp_path}/out.raw")
    assert (done.exit_code, done.stdout) == (0, "")
    assert done.stderr.startswith("4 frames in ")
    assert done.stderr.endswith(f", wrote {tmp_path}/out.raw\n")
    failed = launch("--summary", "fakesrc ! identity error-after=3 ! fakesink")
    assert failed.exit_code == 1
    assert failed.stderr.splitlines()[-1].startswith("2 frames in ")


def test_files_written_are_named_in_place_of_the_pattern(
    launch: Callable[..., Result], tmp_path: Path
) -> None:
    """The first and the last of several; the time in a name is not known before."""
    done = launch("--summary", f"videotestsrc num-buffers=4 ! jpegsink location={tmp_path}/image-%03d.jpg")
    assert done.stderr.endswith(f", wrote 4 files {tmp_path}/image-000.jpg to {tmp_path}/image-003.jpg\n")
    done = launch("--summary", f"videotestsrc num-buffers=4 ! filesink location={tmp_path}/at-%Y.raw")
    (path,) = tmp_path.glob("at-*.raw")
    assert done.stderr.endswith(f", wrote {path}\n")
    small = "dronetestsrc num-buffers=3 ! video/x-raw,width=320,height=240"
    text = f"{small} ! stitch location={tmp_path}/m-%d.png ! fakesink"
    assert f", wrote {tmp_path}/m-0.png\n" in launch("--summary", text).stderr
    assert launch("videotestsrc num-buffers=1 ! textoverlay text=a ! fakesink").exit_code == 0


def test_a_file_that_could_not_be_finished_is_named_as_a_part(tmp_path: Path) -> None:
    """As where the disk is full: it has fewer frames than have arrived. Limited here by the kernel."""
    description = (
        f"videotestsrc num-buffers=9 ! video/x-raw, format=GRAY8 ! filesink location={tmp_path}/out.raw"
    )
    command = [sys.executable, "-m", "streamkit", "launch", "--summary", "json", description]

    def limit_size() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    done = subprocess.run(
        command, preexec_fn=limit_size, capture_output=True, text=True, timeout=patience(60), check=False
    )
    assert (done.returncode, json.loads(done.stdout)["incomplete"]) == (1, [f"{tmp_path}/out.raw"])
    assert done.stderr.endswith(f", wrote part of {tmp_path}/out.raw\n")


def test_words() -> None:
    """One track, two tracks; drops only where there are some; the number of files where there are several."""
    made = RunSummary(elapsed_s=2.0, frames=10, dropped=0, results={"tracks": 1}, files={})
    assert as_text(made) == "10 frames in 2.0 s, 5.0/s, 1 confirmed track"
    made = RunSummary(
        elapsed_s=2.0, frames=10, dropped=3, reasons={"queue full": 2, "no target with a place": 1},
        results={"tracks": 2}, files={"a": 1, "b-%d": 3},
    )  # fmt: skip
    assert as_text(made) == (
        "10 frames in 2.0 s, 5.0/s, dropped 3 (no target with a place: 1; queue full: 2), "
        "2 confirmed tracks, wrote a and 3 files b-%d"
    )
    made = RunSummary(
        elapsed_s=0.0, frames=1, dropped=0, results={}, files={"a": 1, "b-%d": 3}, incomplete=["a", "b-%d"]
    )
    assert as_text(made) == "1 frame in 0.0 s, wrote part of a and 3 files b-%d (the last in part)"
    assert as_text(
        RunSummary(elapsed_s=0.0, frames=2, dropped=0, reasons={}, results={}, files={"-": 1})
    ) == ("2 frames in 0.0 s, wrote to the standard output")
    assert dropped_text({"queue full": 2}) == "2 (queue full)"


def test_frames_are_those_of_the_video(launch: Callable[..., Result]) -> None:
    """Packets of telemetry or records beside it do not count."""
    text = "videotestsrc num-buffers=4 ! fakesink  fakesrc num-buffers=9 ! fakesink"
    assert json.loads(launch("--summary=json", text).stdout)["frames"] == 4
    assert json.loads(launch("--summary=json", "fakesrc num-buffers=9 ! fakesink").stdout)["frames"] == 9


def test_frames_are_those_that_arrived_at_a_sink(launch: Callable[..., Result]) -> None:
    """Not those that a source read or an element dropped on the way."""
    text = "videotestsrc num-buffers=9 ! identity drop-probability=1 ! fakesink"
    found = json.loads(launch("--summary=json", text).stdout)
    assert (found["frames"], found["dropped"]) == (0, 9)
