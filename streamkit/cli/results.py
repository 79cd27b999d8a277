"""What `streamkit launch` prints and writes when a run has ended: its counters and its last line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import typer

from streamkit.cli.stderr import exit_with_error
from streamkit.cli.summary import as_text, summarise, written_files
from streamkit.errors import write_remedy
from streamkit.graph.files import user_of
from streamkit.masking import mask_secrets, presentable_value
from streamkit.output.file import check_writable, write_whole

if TYPE_CHECKING:
    from streamkit.cli.display import Display
    from streamkit.cli.run import Run
    from streamkit.flow.statistics import RunStatistics
    from streamkit.graph.pipeline import Pipeline


def check_stats_file(file: Path, pipeline: Pipeline) -> None:
    """Exits, before a run, where the file of counters is one of the pipeline's or cannot be written."""
    if user := user_of(file, pipeline.graph.elements):
        text = f"{file} is a file of {user}; name another"
        raise typer.BadParameter(text, param_hint="--stats-file")
    try:
        check_writable(file)
    except OSError as error:
        exit_with_error(_write_failure(file, error))


def print_results(
    run: Run, stats: str | None, stats_file: Path | None, summary: str | None, *, strict: bool
) -> int:
    """Prints and writes what a run has counted and made; `stats` and `summary` are "text" or "json".

    Returns:
        1 if the counters cannot be written, or with `strict` if something was not made; else 0.
    """
    assert run.statistics is not None
    code, display, printer = 0, run.display, run.printer
    statistics = msgspec.structs.replace(run.statistics, shortfalls=printer.shortfalls)
    if strict and printer.shortfalls:
        code = 1
        if printer.quiet:  # else they were printed as warnings
            display.print_each("error", printer.shortfalls)
    if stats == "json":
        typer.echo(to_json(statistics))
    made = summarise(statistics)
    if summary == "json":
        typer.echo(to_json(made))
    if stats_file is not None and not _write_counters(stats_file, statistics, display):
        code = 1
    if summary == "text" or (run.has_played and not printer.quiet):
        display.print_line(as_text(made, written_files(statistics)))
    return code


def _write_counters(file: Path, statistics: RunStatistics, display: Display) -> bool:
    """Writes the counters into a file; prints an error and returns False if that fails."""
    try:
        write_whole(file, (to_json(statistics) + "\n").encode())
    except OSError as error:
        display.print_line(f"error: {_write_failure(file, error)}")
        return False
    return True


def _write_failure(file: Path, error: OSError) -> str:
    return f"--stats-file {file} cannot be written: {error.strerror}{write_remedy(error)}"


def to_json(value: msgspec.Struct) -> str:
    """Counters as one JSON object, on one line."""
    plain = presentable_value(msgspec.to_builtins(value), mask_secrets)
    return msgspec.json.encode(plain).decode()
