"""OutputFile: a file that grows beside an older one of its name, and replaces it once it holds something."""

from __future__ import annotations

import errno
import io
import os
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

FLUSH_S = 1.0
LONGEST_NAME = 200  # of 255 bytes, for what is added to it


class OutputFile(io.FileIO):
    """A file without buffer whose writes are whole.

    Where there is an older file, it is written as `.NAME.PID.partial` in the same folder, and takes the path
    with `publish`. Missing folders are made. A device, pipe or socket is opened itself. Through a link the
    file it names is replaced.

    Args:
        path: of the file.
        append: continue a file that is there.
        is_whole: show it only when it is finished, also where there is no older file.

    Attributes:
        path: of the file.
        failure: the first error of a write; libraries do not pass on all of them.
        is_new: whether it does not continue a file.

    Raises:
        OSError: it cannot be written.
    """

    failure: OSError | None = None

    def __init__(self, path: Path, *, append: bool = False, is_whole: bool = False) -> None:
        self.path = path
        self._target = path.resolve()
        self._unpublished: Path | None = None
        if not is_special(path):
            self._target.parent.mkdir(parents=True, exist_ok=True)
            is_there = self._target.exists()
            if is_whole or (is_there and not append):
                name = f".{self._target.name[:LONGEST_NAME]}.{os.getpid()}.partial"
                self._unpublished = self._target.with_name(name)
            elif not is_there:
                self._unpublished = self._target
        super().__init__(self._unpublished or path, "ab" if append else "wb")
        self._pending = bytearray()
        self._tail: Callable[[], bytes] | None = None
        self._end = self.tell() if append and self.seekable() else 0
        self._written_tail = b""
        self._due_s = 0.0
        self.is_new = not self._end

    def write(self, data: ReadableBuffer, /) -> int:
        """Writes all of the data."""
        rest = memoryview(data).cast("B")
        size = rest.nbytes
        try:
            while rest:
                rest = rest[super().write(rest) or 0 :]
        except OSError as error:
            self.failure = self.failure or error
            raise
        return size

    def append(self, data: bytes | memoryview, tail: Callable[[], bytes] | None = None) -> None:
        """Adds a piece to a file that others read while it grows.

        Without a tail it is with the operating system when this returns. A format that ends in a tail, as
        JSON in brackets, is written with it once a second, and whole after each write: the next one begins
        where the tail did. A piece that does not fit leaves the file as it was.

        Args:
            data: the bytes.
            tail: returns the bytes that close the file.

        Raises:
            OSError: the piece cannot be written.
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
        """Writes a piece in place of the tail, and the next tail behind it."""
        try:
            if self._written_tail:
                self.seek(self._end)
            size = self.write(piece)
            self.write(tail)
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
        """Takes the path, in place of an older file; has no effect the second time."""
        if self._unpublished is not None and self._unpublished != self._target:
            self._unpublished.replace(self._target)
        self._unpublished = None

    def finish(self) -> None:
        """Writes what is pending, closes the file and publishes it. Safe to call twice.

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

    def abandon(self) -> None:
        """Closes the file after an error; what is written stays, unless an older file is there."""
        if self._unpublished == self._target and not self.closed and self.tell():
            self._unpublished = None
        self.discard()

    def discard(self) -> None:
        """Closes the file; what was not published is removed. Never fails."""
        with suppress(OSError):
            self.close()
        written, self._unpublished = self._unpublished, None
        if written is not None:
            with suppress(OSError):
                written.unlink(missing_ok=True)


def is_special(path: Path) -> bool:
    """Whether a path names a device, pipe or socket, or one of this process's own open files."""
    if str(path).startswith(("/dev/", "/proc/")):
        return True
    try:
        return not (stat.S_ISREG(path.stat().st_mode) or path.is_dir())
    except OSError:
        return False


def check_writable(path: Path) -> None:
    """Checks that a file can be made at a path, without making anything.

    Raises:
        OSError: it is a directory, or its folder (or the nearest one that exists) takes no files.
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
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
