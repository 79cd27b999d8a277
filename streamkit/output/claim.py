"""Locks (flock) by which a file has one writer at a time, in this process and any other of this machine."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path


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
