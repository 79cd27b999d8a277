"""OutputFile: an output file with one writer at a time, which replaces an older one once it has content."""

from __future__ import annotations

import errno
import fcntl
import io
import os
import select
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from streamkit.output.pipe import STANDARD_OUTPUT, ReaderWait, open_fifo, standard_output, wait_writable

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

FLUSH_S = 1.0
MAX_NAME_LENGTH = 200  # of 255 bytes, for what is added to it


class Claim:
    """The exclusive right to write or replace a file, until `release` or the end of the process."""

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def take(self, path: Path) -> None:
        """Claims the file that a path has now; it may be another one than at the last call.

        One that is not there, or cannot be read, needs no claim.

        Raises:
            OSError: another writer has it.
        """
        try:
            found = os.open(path, os.O_RDONLY)
        except OSError:
            return
        if self._descriptor is not None and os.path.sameopenfile(found, self._descriptor):
            os.close(found)
            return
        self.release()
        self._descriptor = found
        try:
            claim(found)
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Gives it up; has no effect the second time."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)


def claim(descriptor: int) -> None:
    """Claims an open file, until it is closed or the process ends.

    Raises:
        OSError: another writer has it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(errno.EBUSY, "another process or pipeline is writing this file") from error
    except OSError:
        pass  # a file system without locks


def check_unclaimed(path: Path) -> None:
    """Checks that nothing writes a file.

    Raises:
        OSError: a writer has it.
    """
    trial = Claim()
    trial.take(path)
    trial.release()


def open_unchanged(path: str, flags: int) -> int:
    """Opens a file as `open` does, without emptying it: it may be another's."""
    return os.open(path, flags & ~os.O_TRUNC, 0o666)


class OutputFile(io.FileIO):
    """An unbuffered file; each write is complete or fails.

    If the path exists, the file is written as `.NAME.PID.partial` in its folder and renamed by `publish`.
    Missing folders are made. Devices, pipes and sockets are opened directly; symbolic links are followed.
    A file that another process or sink is writing is left to it.

    Args:
        path: of the file; `-` is the standard output.
        append: whether to continue an existing file.
        is_whole: whether the path appears only with the finished file, or the first piece of `append`, also
            if there is no older file.

    Attributes:
        path: of the file.
        failure: the first error of a write; some libraries hide it.
        is_new: whether it does not continue an existing file.

    Raises:
        OSError: the file cannot be opened, or another writer has it.
    """

    failure: OSError | None = None

    def __init__(
        self,
        path: Path,
        *,
        append: bool = False,
        is_whole: bool = False,
        reader_wait: ReaderWait = ReaderWait(),  # noqa: B008 - frozen; the event of the default is never set
    ) -> None:
        self.path, self._reader_wait = path, reader_wait
        self._target = path.resolve()
        self._written = self._target  # where the bytes are until the file is published
        self._is_published = True
        self._older = Claim()  # of the file that this one replaces
        is_file = not is_special(path)
        if is_file:
            self._target.parent.mkdir(parents=True, exist_ok=True)
            is_there = self._target.exists()
            self._is_published = is_there and append and not is_whole
            if is_whole or (is_there and not append):
                name = f".{self._target.name[:MAX_NAME_LENGTH]}.{os.getpid()}.partial"
                self._written = self._target.with_name(name)
        opened: Path | int = self._written if is_file else path
        if is_stdout := str(path) == STANDARD_OUTPUT:
            opened = standard_output()
        elif path.is_fifo():
            opened = open_fifo(path, reader_wait)
        opener = open_unchanged if is_file else None
        super().__init__(opened, "ab" if append else "wb", closefd=not is_stdout, opener=opener)
        if is_file:
            self._claim(is_emptied=not append)
        self._waits_for_reader = not stat.S_ISREG(os.fstat(self.fileno()).st_mode)
        self._pending = bytearray()
        self._tail: Callable[[], bytes] | None = None
        self._end = self.tell() if append and self.seekable() else 0
        self._written_tail = b""
        self._due_s = 0.0
        self.is_new = not self._end

    def _claim(self, *, is_emptied: bool) -> None:
        try:
            claim(self.fileno())
        except OSError:
            self.close()
            raise
        if self._written != self._target:
            try:
                self._older.take(self._target)
            except OSError:
                self.discard()
                raise
        if is_emptied:
            self.truncate(0)

    def write(self, data: ReadableBuffer, /) -> int:
        """Writes all of the data; after a failed write to a pipe nothing more is tried."""
        rest = memoryview(data).cast("B")
        size = rest.nbytes
        if self.failure is not None and self._waits_for_reader:
            raise self.failure
        try:
            while rest:
                piece = rest
                if self._waits_for_reader:
                    wait_writable(self.fileno(), self._reader_wait)
                    piece = rest[: select.PIPE_BUF]
                rest = rest[super().write(piece) or 0 :]
        except OSError as error:
            self.failure = self.failure or error
            raise
        return size

    def append(self, data: bytes | memoryview, tail: Callable[[], bytes] | None = None) -> None:
        """Appends data to a file that others may read at any time.

        Without a tail the data is written at once. A format with a tail, such as a bracket, is written
        once a second, each time with its tail, which the next write replaces. A failed write is undone.

        Args:
            data: the bytes.
            tail: returns the bytes that complete the file.

        Raises:
            OSError: the data cannot be written.
        """
        if tail is None:
            self._write_piece(data, b"")
            return
        self._pending += data
        self._tail = tail
        if time.monotonic() >= self._due_s:
            self._write_pending(tail)

    def _write_pending(self, tail: Callable[[], bytes]) -> None:
        piece, self._pending = self._pending, bytearray()
        self._write_piece(piece, tail() if self.seekable() else b"")  # a pipe gets the tail last
        self._due_s = time.monotonic() + FLUSH_S

    def _write_piece(self, piece: ReadableBuffer, tail: bytes) -> None:
        """Replaces the tail by data and the new tail."""
        try:
            if self._written_tail:
                self.seek(self._end)
            size = memoryview(piece).nbytes
            self.write(
                bytes(piece) + tail if tail else piece
            )  # one call: a killed process leaves no piece alone
            if len(tail) + size < len(self._written_tail):
                self.truncate()
        except OSError:
            self._restore()
            raise
        self._end += size
        self._written_tail = tail
        self.publish()

    def _restore(self) -> None:
        with suppress(OSError):
            self.seek(self._end)
            self.write(self._written_tail)
            self.truncate()

    def publish(self) -> None:
        """Renames the file to its path, replacing an older one; has no effect the second time.

        Raises:
            OSError: another writer has the older one.
        """
        if not self._is_published and self._written != self._target:
            self._older.take(self._target)
            self._written.replace(self._target)
            self._older.release()
        self._is_published = True

    def finish(self) -> None:
        """Writes pending data, closes the file and publishes it; has no effect the second time.

        Raises:
            OSError: writing failed.
        """
        if self.closed:
            return
        if self._tail is not None:
            self._write_pending(self._tail)
            if not self.seekable():
                self.write(self._tail())
        self.close()
        self.publish()

    @property
    def hides_older(self) -> bool:
        """Whether an older file is still at the path, which this one replaces when it is published."""
        return not self._is_published and self._written != self._target and self._target.exists()

    def abandon(self) -> None:
        """Closes the file after an error; keeps what is written unless there is an older file."""
        is_in_place = not self._is_published and self._written == self._target
        if is_in_place and not self.closed and self.tell():
            self._is_published = True
        self.discard()

    def discard(self) -> None:
        """Closes the file and removes it unless it was published; never fails."""
        self._older.release()
        with suppress(OSError):
            self.close()
        is_published, self._is_published = self._is_published, True
        if not is_published:
            with suppress(OSError):
                self._written.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file, in place of an older one when it is whole.

    Raises:
        OSError: it cannot be written; an older file is as it was.
    """
    file = OutputFile(path, is_whole=True)
    try:
        file.write(content)
        file.finish()
    finally:
        file.discard()


def is_special(path: Path) -> bool:
    """Whether a path is a device, pipe, socket, an open file of this process, or `-`."""
    if str(path) == STANDARD_OUTPUT or str(path).startswith(("/dev/", "/proc/")):
        return True
    try:
        return not (stat.S_ISREG(path.stat().st_mode) or path.is_dir())
    except OSError:
        return False


def check_writable(path: Path) -> None:
    """Checks that a file can be created at a path, without creating it.

    Raises:
        OSError: it is a directory, its folder (or the nearest existing one) is not writable, or another
            writer has it.
    """
    if is_special(path):
        return
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    folder = next(parent for parent in target.parents if parent.exists())
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    if not os.access(folder, os.W_OK | os.X_OK):
        number = errno.EROFS if os.statvfs(folder).f_flag & os.ST_RDONLY else errno.EACCES
        raise OSError(number, os.strerror(number), str(folder))  # of EACCES, a PermissionError
    check_unclaimed(target)
