"""OlderFiles: refuses, continues or replaces the files that were at a sink's location before the run."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path

from streamkit.errors import ResourceError
from streamkit.output.file import check_unclaimed
from streamkit.output.names import FileNames


class IfExists(enum.StrEnum):
    """What happens if the file to write exists already."""

    FAIL = "fail"
    CONTINUE = "continue"
    REPLACE = "replace"


@dataclass(frozen=True, slots=True)
class OlderFiles:
    """The files that were there before a run, and whether they may be replaced or continued.

    Attributes:
        names: of these files, and of the run's.
        location: as set, for errors.
        if_exists: what becomes of them.
        can_append: whether the format of one file can be continued.
        example: a location, for errors.
    """

    names: FileNames
    location: str
    if_exists: IfExists
    can_append: bool
    example: str

    def next_number(self) -> int:
        """The number of the run's first file, where several are written.

        Raises:
            ResourceError: there are older ones, which must stay alone.
            OSError: the newest is being written: its writer would meet the files of this run.
        """
        there = {number: path for path, number in self.names.existing()}
        if there and self.if_exists is IfExists.FAIL:
            raise ResourceError(f"{self.location}: {len(there)} such files exist; {self._remedy()}")
        if not there or self.if_exists is not IfExists.CONTINUE:
            return 0
        newest = max(there)
        check_unclaimed(there[newest])
        return newest + 1

    def place(self, path: Path) -> Path:
        """The path of a file of the run: its own, or another one beside an older file of the same second.

        Raises:
            ResourceError: there is an older file, which must stay.
        """
        if self.names.is_several and self.if_exists is IfExists.CONTINUE:
            while path.exists() and not self.names.has_number:
                path = path.with_stem(f"{path.stem}-1")
            return path
        if self.if_exists is IfExists.REPLACE or not path.is_file():
            return path
        if self.if_exists is IfExists.FAIL:
            raise ResourceError(f"{path} exists already; {self._remedy()}")
        if not self.can_append:
            raise ResourceError(
                f"{path} exists already, and its format cannot be continued; {self._remedy()}"
            )
        return path

    def _remedy(self) -> str:
        path = Path(self.example if "%" in self.location else self.location)
        stem, suffix = path.stem, path.suffix
        return (
            f"name another file, number them ({stem}-%05d{suffix}), put the time into the name "
            f"({stem}-%Y%m%dT%H%M%SZ{suffix}), or set if-exists=replace"
        )
