"""What the commands for files of finished runs share: their arguments, the choice of a run, and errors."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from streamkit import RecordFile, ResourceError, StreamError, TrackRecord, write_remedy
from streamkit.output.file import write_whole
from streamkit.output.pipe import STANDARD_INPUT

RecordsArgument = Annotated[
    Path, typer.Argument(help="JSON lines from tracksink.", exists=True, dir_okay=False, readable=True)
]
RecordsOrStandardInput = Annotated[
    Path,
    typer.Argument(
        help="JSON lines from tracksink. - is the standard input.",
        exists=True,
        dir_okay=False,
        readable=True,
        allow_dash=True,
    ),
]
RunOption = Annotated[
    int | None, typer.Option(min=1, help="Of a file with several runs; without it, the last.")
]


@contextlib.contextmanager
def named_file(file: Path) -> Iterator[Path]:
    """The file itself, or for - a temporary one with what the standard input has."""
    if str(file) != STANDARD_INPUT:
        yield file
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "standard-input.jsonl")
        with path.open("wb") as copy:
            shutil.copyfileobj(sys.stdin.buffer, copy)
        yield path


def choose_run(
    path: Path, wanted: int | None, name: Path | None = None, is_meant: Callable[[TrackRecord], bool] = bool
) -> int:
    """The run of a file that is read; a note tells which of several it is, and of a last line left out.

    Args:
        path: JSON lines from tracksink.
        wanted: number of the run, from 1; None is the last with a record that is meant, else the last.
        name: of the file for people, where it is not its path.
        is_meant: by default any record is.

    Raises:
        OSError: the file cannot be read.
        StreamError: there is no such run or no record at all, or a line is no track record.
    """
    name, records = name or path, RecordFile(path)
    last = last_meant = 0
    for run, record in records:
        last = max(last, run)
        if run > last_meant and is_meant(record):
            last_meant = run
    if not last:
        raise StreamError(f"{name}: no record in it")
    if wanted is not None and wanted > last:
        raise StreamError(f"{name}: no run {wanted}, it has {last}")
    chosen = wanted or last_meant or last
    if wanted is None and last > 1:
        typer.echo(f"note: {name} has {last} runs, this is run {chosen}; see --run", err=True)
    note_cut_off(records, name)
    return chosen


def records_of(path: Path, chosen: int) -> Iterator[TrackRecord]:
    """The records of one run of a file."""
    return (record for run, record in RecordFile(path) if run == chosen)


def note_cut_off(records: RecordFile, name: Path) -> None:
    """Notes on the standard error output that the last line of a file, which was read, is left out."""
    if records.is_cut_off:
        typer.echo(f"note: the last line of {name} is only half written and left out", err=True)


def write_output(path: Path, content: bytes) -> None:
    """Writes a file, in place of an older one when it is whole; raises `ResourceError` where it cannot."""
    try:
        write_whole(path, content)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written: {error.strerror}{write_remedy(error)}") from error


def reason(error: Exception) -> str:
    """What an error says; of the system's with the file, and without its number."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path"
    return str(error)
