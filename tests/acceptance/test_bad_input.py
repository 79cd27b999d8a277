"""Bad input ends within its time limit, with exit code 1 or 2 and one clear error."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import command_line
from tests.slowness import patience

BINARY = Path(sys.executable).with_name("streamkit")
ROOT = Path(__file__).parents[2]
START_UP_S = 8.0


def launch(description: str, limit_s: float) -> subprocess.CompletedProcess[str]:
    """Runs a description to its end, which must come within the limit."""
    limit_s = patience(limit_s + START_UP_S)
    began = time.monotonic()
    done = subprocess.run(
        [str(BINARY), "launch", description],
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
    )
    assert time.monotonic() - began <= limit_s
    return done


def assert_one_clear_error(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    """One error that holds the words; no traceback, no thread left, nothing on stdout."""
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "threads did not end" not in done.stderr
    assert done.stdout == ""
    for word in words:
        assert word in done.stderr
    if code == 1:
        assert sum(line.startswith("error:") for line in done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ("fakesrc ! fakesnk", ('no element "fakesnk"', 'did you mean "fakesink"?', "^^^^^^^")),
        ("fakesrc num-buffers=many ! fakesink", ("num-buffers", "'many'", "whole number")),
        ("fakesrc num-bufers=3 ! fakesink", ("num-bufers", 'did you mean "num-buffers"?')),
        ("queue leaky=sideways ! fakesink", ("leaky", "no, upstream, downstream")),
        ("fakesrc ! ", ("description ends",)),
        ("videotestsrc ! audio/x-raw ! fakesink", ("media type",)),
    ],
)
def test_bad_description_ends_with_2(description: str, words: tuple[str, ...]) -> None:
    """A description that cannot become a graph is refused before anything runs."""
    assert_one_clear_error(command_line.run("launch", description), 2, *words)


def test_missing_file_ends_with_1(tmp_path: Path) -> None:
    """A file that is not there is named."""
    missing = tmp_path / "nowhere.mp4"
    assert_one_clear_error(launch(f"filesrc location={missing} ! decode ! fakesink", 3), 1, str(missing))


def test_directory_ends_with_1(tmp_path: Path) -> None:
    """A folder is no file."""
    assert_one_clear_error(launch(f"filesrc location={tmp_path} ! decode ! fakesink", 3), 1, str(tmp_path))


def test_empty_file_ends_with_1(tmp_path: Path) -> None:
    """A file without content is no video."""
    empty = tmp_path / "empty.mp4"
    empty.touch()
    assert_one_clear_error(launch(f"filesrc location={empty} ! decode ! fakesink", 3), 1, str(empty))


def test_text_named_mp4_ends_with_1(tmp_path: Path) -> None:
    """Text in a file named .mp4 is no video."""
    text = tmp_path / "text.mp4"
    text.write_text("This is a letter, not a video.\n" * 40, encoding="utf-8")
    assert_one_clear_error(launch(f"filesrc location={text} ! decode ! fakesink", 3), 1, str(text))


def test_output_that_cannot_be_written_ends_with_1(tmp_path: Path) -> None:
    """A file that cannot be written is named before the work begins."""
    (tmp_path / "file").touch()
    target = tmp_path / "file" / "folder" / "x.jsonl"
    assert_one_clear_error(launch(f"fakesrc num-buffers=1 ! filesink location={target}", 3), 1, str(target))


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """A TCP port that accepts connections by its backlog and never answers."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(8)
        yield server


def test_refused_rtsp_ends_with_1(listener: socket.socket) -> None:
    """An address where nobody listens is told at once; the password stays hidden."""
    port = listener.getsockname()[1]
    listener.close()
    done = launch(f"rtspsrc location=rtsp://user:hunter2@127.0.0.1:{port}/live ! decode ! fakesink", 6)
    assert_one_clear_error(done, 1, f"127.0.0.1:{port}")
    assert "hunter2" not in done.stderr


def test_silent_rtsp_ends_with_1(listener: socket.socket) -> None:
    """A server that accepts and stays silent is given up after timeout-s, and at most a second more."""
    port = listener.getsockname()[1]
    done = launch(f"rtspsrc location=rtsp://127.0.0.1:{port}/live timeout-s=2 ! decode ! fakesink", 3)
    assert_one_clear_error(done, 1, f"127.0.0.1:{port}")


def test_a_run_that_never_starts_leaves_the_last_results(tmp_path: Path) -> None:
    """A missing input, and an output that is the input, are one error; every file stays as it was."""
    kept = {name: tmp_path / name for name in ("keep.jsonl", "keep.mp4", "flight.mp4")}
    for name, path in kept.items():
        path.write_text(name)
    pipe = ROOT / "pipelines" / "file-to-overlay.pipe"
    for source, overlay, code, words in (
        ("missing.mp4", "keep.mp4", 1, "missing.mp4"),
        ("flight.mp4", "flight.mp4", 2, "must not write"),
    ):
        settings = {
            "input": tmp_path / source,
            "output": kept["keep.jsonl"],
            "overlay": tmp_path / overlay,
        }
        arguments = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
        done = subprocess.run(
            [BINARY, "launch", "-f", pipe, *arguments],
            capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == code, done.stderr
        assert words in done.stderr
    assert {name: path.read_text() for name, path in kept.items()} == {name: name for name in kept}
