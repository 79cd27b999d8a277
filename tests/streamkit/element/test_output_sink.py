"""Sinks that write files: older files, and errors."""

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streamkit import (
    Caps,
    ElementFailure,
    Frame,
    IfExists,
    Message,
    NumberedFilesSink,
    OutputFileSink,
    Pipeline,
    ResourceError,
    StreamkitError,
)
from streamkit.element.output_sink import CLOSE_LIMIT_S
from streamkit.output.file import OutputFile
from streamkit.testing import Harness, ManualClock

BYTES = Caps("application/octet-stream")


class Lines(OutputFileSink):
    """Writes bytes, one file."""

    sink = "ANY"
    example = "out.bin"

    def write(self, frame: Frame) -> None:
        """Appends."""
        assert self.file is not None
        self.file.append(frame.data)


class Appended(Lines):
    """May continue a file."""

    def can_append(self) -> bool:
        """Always."""
        return True


class Parts(NumberedFilesSink):
    """Writes a file for each frame."""

    sink = "ANY"
    example = "part-%03d.bin"

    def begin(self) -> None:
        """No file is open."""

    def write(self, frame: Frame) -> None:
        """One file."""
        self.file = OutputFile(self.next_path())
        self.file.write(frame.data)
        self.file.finish()
        self.file_is_complete(self.file.path)


@pytest.fixture(autouse=True)
def _registered(register: Any) -> None:
    register(lines=Lines, appended=Appended, parts=Parts)


def written(element: str, location: Path, *data: bytes, **properties: Any) -> None:
    """Writes frames with these bytes."""
    with Harness(element, location=str(location), **properties) as harness:
        for piece in data:
            harness.push(Frame(piece, BYTES))
        harness.drain()


def shortfalls(text: str, run: Callable[[Pipeline], Any]) -> list[str]:
    """The shortfalls of a pipeline that a function runs."""
    messages: list[Message] = []
    pipeline = Pipeline.parse(text)
    pipeline.bus.watch(messages.append)
    with pipeline, suppress(StreamkitError):
        run(pipeline)
    return [message.text for message in messages if message.fields.get("code") == "shortfall"]


def test_a_stop_before_the_first_frame_is_reported_as_eos_is(tmp_path: Path) -> None:
    """Not where the pipeline has not played, is paused, fails, or has given a frame."""
    path = tmp_path / "a.bin"
    nothing = [f"{path}: no frame came, nothing is written"]
    dead, alive = (
        f"appsrc is-live=true ! lines location={path}",
        f"fakesrc sizetype=fixed ! lines name=sink location={path}",
    )
    assert shortfalls(dead, Pipeline.play) == nothing
    assert shortfalls(f"fakesrc num-buffers=0 ! lines location={path}", Pipeline.run) == nothing
    assert shortfalls(dead, Pipeline.ready) == []
    assert shortfalls(dead, Pipeline.pause) == []
    assert shortfalls(f"fakesrc ! identity error-after=1 ! lines location={path}", Pipeline.run) == []

    def play_until_it_is_made(pipeline: Pipeline) -> None:
        pipeline.play()
        while not pipeline["sink"].has_begun:
            time.sleep(0.01)

    assert shortfalls(alive, play_until_it_is_made) == []


@pytest.mark.parametrize(
    ("element", "if_exists", "content"),
    [
        ("lines", IfExists.REPLACE, b"new"),
        ("lines", IfExists.FAIL, None),
        ("lines", IfExists.CONTINUE, None),
        ("appended", IfExists.CONTINUE, b"oldnew"),
    ],
)
def test_an_older_file_is_replaced_continued_or_refused(
    tmp_path: Path, element: str, if_exists: IfExists, content: bytes | None
) -> None:
    """A refusal precedes the first frame and names remedies."""
    path = tmp_path / "a.bin"
    written(element, path, b"old", if_exists=if_exists)
    if content is not None:
        written(element, path, b"new", if_exists=if_exists)
    else:
        with pytest.raises(
            ResourceError, match=r"already.*; name another file.* \(a-%05d\.bin\).*%Y.*if-exists=replace"
        ):
            written(element, path, b"new", if_exists=if_exists)
    assert path.read_bytes() == (content or b"old")


@pytest.mark.parametrize(
    ("if_exists", "names"),
    [(IfExists.CONTINUE, "000 001 002 003"), (IfExists.REPLACE, "000 001"), (IfExists.FAIL, None)],
)
def test_numbers_of_older_files_are_continued(tmp_path: Path, if_exists: IfExists, names: str | None) -> None:
    """So that none is overwritten."""
    for _ in range(2):
        if names is None and list(tmp_path.iterdir()):
            with pytest.raises(ResourceError, match=r"2 such files exist; name another"):
                written("parts", tmp_path / "p-%03d.bin", b"a", if_exists=if_exists)
            return
        written("parts", tmp_path / "p-%03d.bin", b"a", b"b", if_exists=if_exists)
    assert [path.stem[2:] for path in sorted(tmp_path.iterdir())] == (names or "").split()


def test_times_in_names(tmp_path: Path) -> None:
    """UTC; two files of one second get two names."""
    clock = ManualClock(1_763_690_000 * 10**9)
    with Harness("parts", location=f"{tmp_path}/p-%Y%m%dT%H%M%SZ.bin", clock=clock) as harness:
        for _ in range(2):
            harness.push(Frame(b"a", BYTES))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "p-20251121T015320Z-1.bin", "p-20251121T015320Z.bin",
    ]  # fmt: skip


def test_only_the_newest_files_are_kept(tmp_path: Path) -> None:
    """Across runs; files of others are never deleted."""
    (tmp_path / "p-100.bin").write_bytes(b"mine")
    for _ in range(2):
        written("parts", tmp_path / "p-%03d.bin", b"a", b"b", b"c", max_files=2)
    kept = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("."))
    assert kept == ["p-100.bin", "p-105.bin", "p-106.bin"]


def test_a_stop_before_the_first_frame_leaves_the_older_file(tmp_path: Path) -> None:
    """For example Ctrl-C while a source connects."""
    (tmp_path / "a").write_bytes(b"old")
    Harness("lines", location=str(tmp_path / "a")).close()
    assert (tmp_path / "a").read_bytes() == b"old"


@pytest.mark.parametrize("element", ["lines", "parts"])
def test_a_file_that_could_not_be_made_is_not_counted(element: str) -> None:
    """The last line of a run names what was written."""
    with Harness(element, location="/proc/a-%d.bin" if element == "parts" else "/proc/a.bin") as harness:
        with pytest.raises(ElementFailure, match="cannot be written"):
            harness.push(Frame(b"a", BYTES))
        assert harness.element.results["files"] == 0
        assert harness.element.written_paths == ()


def test_an_error_is_raised_once(tmp_path: Path) -> None:
    """Neither EOS nor the stop raises another one."""
    with Harness("lines", location="/dev/full") as harness:
        with pytest.raises(
            ElementFailure, match=r"location=/dev/full: cannot be written: No space .*free some"
        ):
            harness.push(Frame(b"a", BYTES))
        harness.drain()
        assert not [message for message in harness.messages if message.text]


@pytest.mark.parametrize("pts", [float("nan"), 1.5, "1"])
def test_a_time_that_is_no_integer_is_an_error(tmp_path: Path, pts: Any) -> None:
    """Integers of NumPy are accepted."""
    with Harness("lines", location=str(tmp_path / "a")) as harness:
        harness.push(Frame(b"a", BYTES, pts=np.int64(5)))  # type: ignore[arg-type]
        with pytest.raises(ElementFailure, match="the pts of a frame must be an integer, ns, or None"):
            harness.push(Frame(b"b", BYTES, pts=pts))
    assert (tmp_path / "a").read_bytes() == b"a"


def test_a_writer_that_does_not_return_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop does not use the file at the same time."""
    monkeypatch.setattr("streamkit.element.output_sink.CLOSE_LIMIT_S", 0.01)
    assert CLOSE_LIMIT_S > 1
    sink = Lines(location=str(tmp_path / "a"))
    sink.start()
    with sink._writing, pytest.raises(ResourceError, match=r"writing took more than 0\.01 s"):
        sink.stop()
