"""OutputFile: replaces an older file when it holds something."""

import errno
import json
import os
import resource
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from streamkit.output.file import OutputFile, check_writable
from streamkit.output.pipe import ReaderWait

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def test_an_older_file_stays_until_there_is_something(tmp_path: Path) -> None:
    """Opened and discarded, the older file and nothing else is there; published, the new one is."""
    path = tmp_path / "t.jsonl"
    path.write_bytes(b"old")
    OutputFile(path).discard()
    assert path.read_bytes() == b"old"
    file = OutputFile(path)
    assert path.read_bytes() == b"old"
    file.append(b"new\n")
    assert path.read_bytes() == b"new\n"
    file.append(b"more\n")
    assert path.read_bytes() == b"new\nmore\n"
    file.finish()
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.jsonl"]


@pytest.mark.parametrize("append", [False, True])
@pytest.mark.parametrize("is_older", [False, True])
def test_a_file_has_one_writer(tmp_path: Path, append: bool, is_older: bool) -> None:
    """A second one is refused while the first is open, and changes nothing of what that writes."""
    path = tmp_path / "t.jsonl"
    if is_older:
        path.write_bytes(b"old\n")
    first = OutputFile(path, append=append)
    first.append(b"one\n")
    with pytest.raises(OSError, match="another process or pipeline is writing this file"):
        OutputFile(path, append=append)
    with pytest.raises(OSError, match="another process or pipeline is writing this file"):
        check_writable(path)
    first.append(b"two\n")
    first.finish()
    assert path.read_bytes() == (b"old\n" if is_older and append else b"") + b"one\ntwo\n"
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.jsonl"]
    check_writable(path)


@pytest.mark.parametrize("is_older", [False, True])
def test_of_two_that_replace_a_file_the_later_is_refused(tmp_path: Path, is_older: bool) -> None:
    """Another process, too, and before either has published, as recordings in their first second."""
    path = tmp_path / "a.mp4"
    text = "import sys; from pathlib import Path; from streamkit.output.file import OutputFile\n"
    text += "OutputFile(Path(sys.argv[1])).append(b'x')"
    command = [sys.executable, "-c", text, str(path)]
    if is_older:
        path.write_bytes(b"old")
    file = OutputFile(path)
    file.write(b"own")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "another process or pipeline is writing this file" in done.stderr
    file.finish()
    assert path.read_bytes() == b"own"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mp4"]
    subprocess.run(command, check=True)
    assert path.read_bytes() == b"x"


def test_an_older_file_is_claimed_until_it_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A writer that comes amid the replacement is refused."""
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    replace = Path.replace

    def replace_amid_another(self: Path, target: Path) -> Path:
        with pytest.raises(OSError, match="another process or pipeline is writing this file"):
            OutputFile(path, append=True)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", replace_amid_another)
    file = OutputFile(path)
    file.write(b"new")
    file.finish()
    assert path.read_bytes() == b"new"


def test_a_whole_file_does_not_replace_one_that_is_being_written(tmp_path: Path) -> None:
    """Which was begun after it."""
    path = tmp_path / "a.bin"
    whole, other = OutputFile(path, is_whole=True), OutputFile(path)
    other.append(b"other")
    whole.write(b"whole")
    with pytest.raises(OSError, match="another process or pipeline is writing this file"):
        whole.finish()
    whole.discard()
    other.finish()
    assert path.read_bytes() == b"other"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_folders_are_made_and_links_followed(tmp_path: Path) -> None:
    """A link goes on naming the file that was written."""
    (tmp_path / "link.bin").symlink_to(tmp_path / "a" / "b" / "file.bin")
    for content in (b"one", b"two"):
        file = OutputFile(tmp_path / "link.bin")
        file.append(content)
        file.finish()
        assert (tmp_path / "a" / "b" / "file.bin").read_bytes() == content
    assert (tmp_path / "link.bin").is_symlink()


def test_a_whole_file_appears_when_it_is_finished(tmp_path: Path) -> None:
    """No incomplete file is visible."""
    file = OutputFile(tmp_path / "a.npz", is_whole=True)
    file.write(b"half")
    assert not (tmp_path / "a.npz").exists()
    file.finish()
    assert (tmp_path / "a.npz").read_bytes() == b"half"


def test_a_file_with_a_tail_is_whole_after_each_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What others read is always JSON, also where the tail becomes shorter."""
    monkeypatch.setattr("streamkit.output.file.FLUSH_S", 0.0)
    path = tmp_path / "a.json"

    file = OutputFile(path)
    file.append(b"[0", lambda: b",-1,-2]")
    assert json.loads(path.read_bytes()) == [0, -1, -2]
    for number in range(1, 4):
        file.append(f",{number}".encode(), lambda: b"]")
        assert json.loads(path.read_bytes()) == [*range(number + 1)]
    file.finish()
    assert json.loads(path.read_bytes()) == [0, 1, 2, 3]


def test_no_call_leaves_a_file_without_its_tail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a process may be killed between any two of them."""
    monkeypatch.setattr("streamkit.output.file.FLUSH_S", 0.0)
    path = tmp_path / "a.json"
    seen = []

    class CheckedFile(OutputFile):
        """Reads the file after each call to the system."""

        def write(self, data: "ReadableBuffer", /) -> int:
            size = super().write(data)
            seen.append(json.loads(path.read_bytes()) if path.exists() else None)
            return size

    file = CheckedFile(path, is_whole=True)
    assert not path.exists()
    for number in range(4):
        file.append(b"[0" if not number else f",{number}".encode(), lambda: b"]")
    file.finish()
    assert seen == [None, [0, 1], [0, 1, 2], [0, 1, 2, 3], [0, 1, 2, 3]]


def test_a_tail_is_written_once_a_second(tmp_path: Path) -> None:
    """Pieces in between wait for the next write; the end has all."""
    path = tmp_path / "a.json"
    file = OutputFile(path)
    for number in range(100):
        file.append(b"1" if not number else b",1", lambda: b"")
    assert path.read_bytes() == b"1"
    file.finish()
    assert path.read_bytes().count(b"1") == 100


def test_devices_are_opened_themselves() -> None:
    """No file is made beside a device, and its errors are kept."""
    file = OutputFile(Path("/dev/full"))
    with pytest.raises(OSError, match="No space left"):
        file.append(b"x")
    assert file.failure is not None
    assert file.failure.errno == errno.ENOSPC
    file.discard()
    assert Path("/dev/full").exists()


@pytest.mark.parametrize("tail", [b"", b"]" * 300])
def test_a_piece_that_does_not_fit_leaves_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tail: bytes
) -> None:
    """With its tail, if it has one."""
    monkeypatch.setattr("streamkit.output.file.FLUSH_S", 0.0)
    path, limits = tmp_path / "a", resource.getrlimit(resource.RLIMIT_FSIZE)
    file = OutputFile(path)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        file.append(b"x" * 600, (lambda: tail) if tail else None)
        with pytest.raises(OSError, match="File too large"):
            file.append(b"y" * 600, (lambda: tail) if tail else None)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    file.abandon()
    assert path.read_bytes() == b"x" * 600 + tail


def test_abandon_keeps_what_is_written(tmp_path: Path) -> None:
    """But it does not replace an older file."""
    (tmp_path / "old").write_bytes(b"old")
    for name, left in (("old", b"old"), ("new", b"part")):
        file = OutputFile(tmp_path / name)
        file.write(b"part")
        file.abandon()
        assert (tmp_path / name).read_bytes() == left
    OutputFile(tmp_path / "empty").abandon()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "old"]


def test_check_writable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder, a file as a folder, and a read-only folder; nothing is made."""
    (tmp_path / "file").touch()
    check_writable(tmp_path / "a" / "b" / "c.txt")
    with pytest.raises(IsADirectoryError):
        check_writable(tmp_path)
    with pytest.raises(NotADirectoryError):
        check_writable(tmp_path / "file" / "a" / "c.txt")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(PermissionError):
        check_writable(tmp_path / "c.txt")
    read_only = SimpleNamespace(f_flag=os.ST_RDONLY)
    monkeypatch.setattr(os, "statvfs", lambda _: read_only)
    with pytest.raises(OSError, match="Read-only file system"):
        check_writable(tmp_path / "c.txt")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_a_pipe_gets_the_tail_at_the_end(tmp_path: Path) -> None:
    """What reads it sees the pieces in order, and one tail."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    file = OutputFile(path)
    file.append(b"[0", lambda: b"]")
    assert os.read(reader, 10) == b"[0"
    file.append(b",1", lambda: b"]")
    file.finish()
    assert os.read(reader, 10) == b",1]"
    os.close(reader)


def test_a_named_pipe_without_a_reader_is_an_error(tmp_path: Path) -> None:
    """Opening it would wait for ever."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(TimeoutError, match=r"its reader has taken nothing for 0\.2 s"):
        OutputFile(path, reader_wait=ReaderWait(0.2))


def test_a_pipe_whose_reader_stops_fails_once(tmp_path: Path) -> None:
    """What follows fails at once; a reader that takes its time gets everything."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    file = OutputFile(path, reader_wait=ReaderWait(1.5))
    with pytest.raises(TimeoutError):
        file.write(bytes(1 << 20))
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        file.write(b"more")
    assert time.monotonic() - began < 1.5
    file.discard()
    os.close(reader)


def test_a_stop_ends_the_wait_for_a_reader(tmp_path: Path) -> None:
    """Whatever the limit."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    stopping = threading.Event()
    stopping.set()
    with pytest.raises(TimeoutError, match="nothing for 1 s"):
        OutputFile(path, reader_wait=ReaderWait(600, stopping))
