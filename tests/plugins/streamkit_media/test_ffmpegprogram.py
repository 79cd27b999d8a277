"""The program ffmpeg: which one is used, and what is left of it."""

import os
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from streamkit import ElementFailure, Pipeline, ResourceError
from streamkit_media.ffmpegprogram import FfmpegProgram, srt_program

pytestmark = pytest.mark.timeout(60)
KNOWS_SRT, KNOWS_NONE = (
    "echo Input:; echo '  udp'; echo '  srtp'; echo '  srt'",
    "echo '  udp'; echo '  srtp'",
)


def program(folder: Path, script: str) -> Path:
    """An ffmpeg that answers a question for its protocols."""
    folder.mkdir()
    path = folder / "ffmpeg"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The program of the package imageio-ffmpeg, which stands in for the real one; it knows SRT."""
    path = program(tmp_path / "package", KNOWS_SRT)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", SimpleNamespace(get_ffmpeg_exe=lambda: str(path)))
    return path


def test_that_of_path_comes_first(tmp_path: Path, package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the user's own."""
    own = program(tmp_path / "own", KNOWS_SRT)
    monkeypatch.setenv("PATH", f"{own.parent}:/bin")
    assert srt_program() == str(own)


def test_that_of_the_package_takes_its_place(
    tmp_path: Path, package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where that of PATH has no SRT, and where there is none."""
    own = program(tmp_path / "own", KNOWS_NONE)
    monkeypatch.setenv("PATH", f"{own.parent}:/bin")
    assert srt_program() == str(package)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert srt_program() == str(package)


def test_none_is_an_error_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything plays."""
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ResourceError, match=r"install ffmpeg, or streamkit\[srt\]"):
        srt_program()
    pipeline = Pipeline.parse("livesrc uri=srt://drone:9000 ! fakesink")
    with pytest.raises(ElementFailure, match=r"install ffmpeg, or streamkit\[srt\]"):
        pipeline.ready()
    pipeline.stop()


def test_output_ends_with_what_was_reported() -> None:
    """Bytes come as they are written; errors are those since the last of them."""
    child = FfmpegProgram(
        ["/bin/sh", "-c", "echo early >&2; sleep 0.2; printf video; sleep 0.2; echo late >&2"]
    )
    ended = threading.Event()
    assert child.read(10, ended) == b"video"
    assert child.read(10, ended) == b""
    assert child.errors() == ["late"]
    child.close()


def test_it_outlives_the_thread_that_asked_for_it() -> None:
    """A sink's file is begun by a thread that streams, and completed by another once that one has ended."""
    found: list[FfmpegProgram] = []
    command = ["/bin/sh", "-c", "echo ready; read line; echo $line"]

    def begin() -> None:
        found.append(FfmpegProgram(command, has_input=True))
        assert found[0].read(10, threading.Event()) == b"ready\n"

    thread = threading.Thread(target=begin)
    thread.start()
    thread.join(10)
    os.write(found[0].input, b"still here\n")
    assert found[0].read(10, threading.Event()) == b"still here\n"
    found[0].end_input()
    assert found[0].has_ended(10)
    assert found[0].code == 0
    found[0].close()


def test_silence_is_bounded() -> None:
    """A program that neither writes nor ends is given up, and killed where it does not listen."""
    child = FfmpegProgram(["/bin/sh", "-c", "trap '' TERM; echo ready; while :; do sleep 0.05; done"])
    ended = threading.Event()
    assert child.read(10, ended) == b"ready\n"
    with pytest.raises(TimeoutError):
        child.read(0.2, ended)
    began = time.monotonic()
    child.close()
    assert time.monotonic() - began < 5


def test_end_is_noticed_amid_a_wait() -> None:
    """`terminate`, from another thread, ends a wait at once."""
    child = FfmpegProgram(["/bin/sleep", "60"])
    ended = threading.Event()
    timer = threading.Timer(0.2, lambda: (ended.set(), child.terminate()))
    timer.start()
    assert child.read(30, ended) == b""
    timer.join()
    child.close()
