"""Retention: deletes the oldest files of a recorder."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from streamkit.settings import setting


@dataclass(frozen=True)
class RetentionLimits:
    """Limits of the complete files kept."""

    max_files: int = setting(0, min=0, doc="Complete files kept; older ones are deleted. 0 keeps all.")
    max_total_size: int = setting(
        0, min=0, unit="bytes", doc="Size of the complete files kept; older ones are deleted. 0 is no limit."
    )
    max_age: int = setting(
        0, min=0, unit="s", doc="Complete files kept: how long; older ones are deleted. 0 is no limit."
    )

    @property
    def is_limited(self) -> bool:
        """Whether there is a limit."""
        return bool(self.max_files or self.max_total_size or self.max_age)


class WrittenFile(msgspec.Struct, frozen=True):
    """A complete file in the ledger."""

    name: str
    inode: int
    size: int
    time_s: float
    companion: str = ""


class Retention:
    """Deletes the oldest complete files beyond the limits; never a file that it did not record.

    The ledger lists files of earlier runs. A file that another program has replaced is kept.

    Args:
        limits: of the files kept.
        folder: of the files.
        ledger: path of the list of recorded files, or None to forget them after the run.
    """

    def __init__(self, limits: RetentionLimits, folder: Path, ledger: Path | None = None) -> None:
        self._limits = limits
        self._folder = folder
        self._ledger = ledger if limits.is_limited else None
        self._files: deque[WrittenFile] = deque()
        if self._ledger is not None and self._ledger.is_file():
            with suppress(msgspec.DecodeError):  # a last line that was cut short
                for line in self._ledger.read_bytes().splitlines():
                    self._files.append(msgspec.json.decode(line, type=WrittenFile))
        self._total = sum(file.size for file in self._files)

    def add(self, path: Path, now_s: float, companion: Path | None = None) -> int:
        """Records a complete file, and one to delete with it; deletes files beyond the limits.

        Returns:
            How many files it has deleted, not counting companions.

        Raises:
            OSError: the ledger cannot be written.
        """
        limits, files = self._limits, self._files
        if not limits.is_limited:
            return 0
        found = path.stat()
        size, companion_name = found.st_size, ""
        if companion is not None and companion.is_file():
            size, companion_name = size + companion.stat().st_size, companion.name
        files.append(WrittenFile(path.name, found.st_ino, size, now_s, companion_name))
        self._total += size
        deleted = 0
        while len(files) > 1 and (
            (limits.max_files and len(files) > limits.max_files)
            or (limits.max_total_size and self._total > limits.max_total_size)
            or (limits.max_age and now_s - files[0].time_s > limits.max_age)
        ):
            deleted += self._delete(files[0])
            self._total -= files.popleft().size
        if self._ledger is not None:
            self._ledger.write_bytes(msgspec.json.Encoder().encode_lines(files))
        return deleted

    def _delete(self, file: WrittenFile) -> bool:
        """Whether the file was there, and is deleted."""
        path = self._folder / file.name
        try:
            if path.stat().st_ino != file.inode:
                return False
            path.unlink()
        except OSError:
            return False
        if file.companion:
            with suppress(OSError):
                path.with_name(file.companion).unlink()
        return True
