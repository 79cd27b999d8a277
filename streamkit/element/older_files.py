"""Refuses, continues or replaces the files that were at a sink's location before the run."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING

from streamkit.errors import ResourceError
from streamkit.output.file import check_unclaimed

if TYPE_CHECKING:
    from streamkit.element.output_sink import OutputFileSink


class IfExists(enum.StrEnum):
    """What happens if the file to write exists already."""

    FAIL = "fail"
    CONTINUE = "continue"
    REPLACE = "replace"


def next_number(sink: OutputFileSink) -> int:
    """The number of the run's first file, where a sink writes several.

    Raises:
        ResourceError: there are older ones, which must stay alone.
        OSError: the newest is being written: its writer would meet the files of this run.
    """
    there = {number: path for path, number in sink.names.existing()}
    if there and sink.if_exists is IfExists.FAIL:
        raise ResourceError(f"{sink.location}: {len(there)} such files exist; {_remedy(sink)}")
    if not there or sink.if_exists is not IfExists.CONTINUE:
        return 0
    newest = max(there)
    check_unclaimed(there[newest])
    return newest + 1


def file_place(sink: OutputFileSink, path: Path) -> Path:
    """The path of a file of the run: the given one, or one beside an older file of the same second.

    Raises:
        ResourceError: there is an older file, which must stay.
    """
    if sink.names.is_several and sink.if_exists is IfExists.CONTINUE:
        while path.exists() and not sink.names.has_number:
            path = path.with_stem(f"{path.stem}-1")
        return path
    if sink.if_exists is IfExists.REPLACE or not path.is_file():
        return path
    if sink.if_exists is IfExists.FAIL:
        raise ResourceError(f"{path} exists already; {_remedy(sink)}")
    if not sink.can_append():
        raise ResourceError(f"{path} exists already, and its format cannot be continued; {_remedy(sink)}")
    return path


def _remedy(sink: OutputFileSink) -> str:
    path = Path(sink.example if "%" in sink.location else sink.location)
    stem, suffix = path.stem, path.suffix
    return (
        f"name another file, number them ({stem}-%05d{suffix}), put the time into the name "
        f"({stem}-%Y%m%dT%H%M%SZ{suffix}), or set if-exists=replace"
    )
