"""A batch on a local Ray: results, failures, resumption, workers that die."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamkit import Pipeline
from streamkit.cli.main import make_app
from streamkit.service.supervisor import STREAMKIT_COMMAND
from streamkit_fleet.local_ray import connected
from tests.slowness import patience

PAGE = Path(__file__).parents[4] / "docs" / "fleet.md"
LISTING = r"^# copy\.pipe\n[^`]*"
COPY = "filesrc location=${input} ! identity sleep-time=${sleep:-0} ! filesink location=${output}\n"


@pytest.fixture(scope="module", autouse=True)
def local_ray() -> Iterator[None]:
    """One Ray for all tests of this module, with two workers."""
    with connected(None, cores=2):
        yield


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of 25 frames."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    text = "videotestsrc num-buffers=25 ! video/x-raw, width=64, height=48"
    Pipeline.parse(f"{text} ! encode ! packetsink location={path}").run(timeout_s=60)
    return path


@pytest.fixture
def archive(tmp_path: Path, clip: Path) -> Path:
    """Three videos, one of them in a folder, and a file that is none."""
    folder = tmp_path / "archive"
    (folder / "day").mkdir(parents=True)
    for name in ("a.mp4", "b.mp4", "day/a.mp4"):
        shutil.copy(clip, folder / name)
    (folder / "bad.mp4").write_text("no video")
    (tmp_path / "copy.pipe").write_text(COPY)
    return folder


def batch(archive: Path, *options: str, pattern: str = "*.mp4") -> tuple[int, str]:
    """Exit code and what was printed."""
    folder = archive.parent
    words = [
        "batch",
        f"{archive}/**/{pattern}",
        "-f",
        f"{folder / 'copy.pipe'}",
        "--output",
        f"{folder / 'out'}",
    ]
    done = CliRunner().invoke(make_app(), [*words, "--suffix", ".h264", *options])
    return done.exit_code, done.stderr


def test_a_file_that_is_cut_short_is_named_in_the_result(tmp_path: Path) -> None:
    """Its frames are there; what is missing is printed, and stands in the summary."""
    archive, path = tmp_path / "archive", tmp_path / "archive" / "cut.mkv"
    text = "videotestsrc num-buffers=150 ! video/x-raw, width=64, height=48, framerate=25/1"
    Pipeline.parse(f"{text} ! encode ! packetsink location={path}").run(timeout_s=60)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (tmp_path / "copy.pipe").write_text(COPY)
    code, printed = batch(archive, pattern="*.mkv")
    assert code == 0
    assert re.search(r"cut\.mkv: the video ends at \d\.\d s of 6\.0 s: the file is cut short", printed)
    (result,) = json.loads((tmp_path / "out" / "batch.json").read_text())["files"].values()
    assert result["status"] == "done"
    assert [text.endswith("the file is cut short") for text in result["shortfalls"]] == [True]


def test_results_are_those_of_a_serial_run_and_a_further_batch_does_what_is_left(archive: Path) -> None:
    """A failed file is listed with its reason, and tried again only on request or with other content."""
    code, printed = batch(archive)
    out = archive.parent / "out"
    assert code == 1
    assert "3 of 4 files are done" in printed
    assert "bad.mp4: filesrc0: " in printed
    serial = archive.parent / "serial.h264"
    Pipeline.parse(COPY, {"input": f"{archive / 'a.mp4'}", "output": f"{serial}"}).run(timeout_s=60)
    written = {str(path.relative_to(out)) for path in out.rglob("*.h264")}
    assert written == {"a.mp4.h264", "b.mp4.h264", "day/a.mp4.h264"}
    assert {(out / name).read_bytes() for name in written} == {serial.read_bytes()}
    assert not (out / ".parts").exists()
    files = json.loads((out / "batch.json").read_text())["files"]
    assert {Path(path).name: one["status"] for path, one in files.items()} == {
        "a.mp4": "done", "b.mp4": "done", "bad.mp4": "failed",
    }  # fmt: skip

    (out / "a.mp4.h264").write_text("kept")
    (out / "b.mp4.h264").unlink()
    code, printed = batch(archive)
    assert code == 1
    assert "failed, as before: " in printed
    assert (out / "a.mp4.h264").read_text() == "kept"
    assert (out / "b.mp4.h264").read_bytes() == serial.read_bytes()
    shutil.copy(archive / "a.mp4", archive / "bad.mp4")
    parts = out / ".parts"
    (parts / "unfinished-1-key-0").mkdir(parents=True)
    for name in ("a.mp4.h264", ".a.mp4.h264.1.partial"):
        (parts / "unfinished-1-key-0" / name).write_text("its worker was killed")
    assert batch(archive)[0] == 0
    assert not parts.exists()


def test_a_link_to_a_file_that_is_gone_has_failed(archive: Path) -> None:
    """As to a disk that is not mounted: it is listed, and tried again on request."""
    (archive / "gone.mp4").symlink_to("nowhere")
    code, printed = batch(archive, pattern="gone.mp4")
    assert code == 1
    assert "gone.mp4: cannot be read: No such file or directory; is the disk mounted" in printed
    assert "0 of 1 files are done" in printed


def test_the_command_of_the_page(tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The listing and the line of docs/fleet.md, as they stand there."""
    page = PAGE.read_text("utf-8")
    (listing,), (line,) = (
        re.findall(what, page, re.MULTILINE) for what in (LISTING, r"^streamkit (batch .*)$")
    )
    (tmp_path / "copy.pipe").write_text(listing)
    (tmp_path / "archive" / "day").mkdir(parents=True)
    shutil.copy(clip, tmp_path / "archive" / "day")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(make_app(), shlex.split(line))
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "copies" / "day" / "clip.mp4.h264").stat().st_size > 0


def parent(process: int | str) -> int:
    """The process that started another."""
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


def worker_at_work(task: str) -> int:
    """A process of this Ray that runs a task, waited for; its parent is the raylet, whose is this."""
    deadline_s = time.monotonic() + patience(40)
    while time.monotonic() < deadline_s:
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                title = (folder / "cmdline").read_bytes()
                if title.startswith(f"ray::{task}".encode()) and parent(parent(folder.name)) == os.getpid():
                    return int(folder.name)
        time.sleep(0.02)
    raise AssertionError(f"no worker runs {task}")


def test_a_killed_worker_loses_no_file(archive: Path) -> None:
    """Its part is run again, and the results are whole."""
    (archive / "bad.mp4").unlink()
    done: list[tuple[int, str]] = []
    thread = threading.Thread(target=lambda: done.append(batch(archive, "--set", "sleep=40000")))
    thread.start()
    os.kill(worker_at_work("run_part"), signal.SIGKILL)
    thread.join(patience(60))
    assert [code for code, _ in done] == [0], done
    sizes = {path.stat().st_size for path in (archive.parent / "out").rglob("*.h264")}
    assert len(sizes) == 1
    assert sizes != {0}


def test_a_termination_is_clean_and_parts_are_counted(archive: Path, tmp_path: Path) -> None:
    """One line says what to do next; Ray's own handler would print the stack of its native code."""
    import ray

    (archive / "bad.mp4").unlink()
    words = [
        "batch",
        f"{archive}/*.mp4",
        "-f",
        f"{tmp_path / 'copy.pipe'}",
        "--output",
        f"{tmp_path / 'out'}",
    ]
    words += ["--set", "sleep=400000", "--address", ray.get_runtime_context().gcs_address]
    process = subprocess.Popen([*STREAMKIT_COMMAND, *words], stderr=subprocess.PIPE, text=True)
    try:
        worker_at_work("run_part")
        process.terminate()
        _, printed = process.communicate(timeout=patience(30))
    finally:
        process.kill()
    assert process.returncode == 130, printed
    assert "SIGTERM" not in printed
    assert re.search(r"files +0/2 .*\n *parts +0/[12] ", printed)
    assert printed.endswith("error: interrupted; the same command does what is left\n")


def test_wrong_usage_is_refused_before_anything_runs(archive: Path) -> None:
    """A description that is invalid or lacks ${output}, and a pattern without files."""
    pipe = archive.parent / "copy.pipe"
    assert batch(archive / "nothing")[0] == 2
    pipe.write_text("filesrc location=${input} ! fakesink")
    code, printed = batch(archive)
    assert code == 2
    assert "has no ${output}" in printed
    pipe.write_text("filesrc location=${input} ! nonsense location=${output}")
    code, printed = batch(archive)
    assert code == 2
    assert "nonsense" in printed
    assert not (archive.parent / "out").exists()
