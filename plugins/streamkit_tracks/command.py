"""The commands `streamkit tracks` and `streamkit convert`, for files of finished runs."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Annotated, Literal

import msgspec
import typer

from streamkit import (
    NO_TIME,
    MessageKind,
    Pipeline,
    RecordFile,
    StreamkitError,
    TrackState,
    exit_with_error,
    needs_extra,
    read_tracks,
)
from streamkit.output.pipe import STANDARD_OUTPUT, until_reader_leaves
from streamkit_tracks.file_formats import KINDS
from streamkit_tracks.recorded_runs import (
    MISSING,
    READERS,
    RecordsOrStandardInput,
    RunOption,
    choose_run,
    named_file,
    note_cut_off,
    reason,
    write_lines,
    write_output,
)

TIMES = ("pts_ns", "capture_ns")  # of `read_tracks`
FileFormat = Literal["jsonl", "mot", "csv", "geojson", "kml", "cot", "mcap", "parquet"]
FORMATS = {**{ending: str(kind) for ending, kind in KINDS.items()}, ".mcap": "mcap", ".parquet": "parquet"}
ENDINGS = ", ".join(FORMATS)
CONFIRMED = TrackState.CONFIRMED.value


class TargetSummary(msgspec.Struct):
    """One target of a file.

    Attributes:
        run: of the file, from 1.
        id: in that run.
        first_s, last_s: time in the stream of its first frame, and of the last before it was lost, s; None if
            unknown. After an interruption the frame that tells of the loss comes much later.
        states: its frames by state, in the order in which they came.
        length_px, width_px: medians over its frames.
    """

    run: int
    id: int
    first_s: float | None = None
    last_s: float | None = None
    states: Counter[str] = msgspec.field(default_factory=Counter)
    length_px: float = 0.0
    width_px: float = 0.0


def tracks(
    file: RecordsOrStandardInput,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object for each target.")] = False,
) -> None:
    """Lists the targets of a finished run: when they were there, in which states, their size."""
    try:
        with named_file(file) as path:
            records = RecordFile(path)
            found = list_targets(records)
    except (OSError, StreamkitError) as error:
        exit_with_error(reason(error))
    note_cut_off(records, file)
    as_lines = [msgspec.json.encode(target).decode() for target in found] if as_json else table_lines(found)
    with until_reader_leaves():
        for line in as_lines:
            typer.echo(line)
    confirmed = sum(CONFIRMED in target.states for target in found)
    if not found:
        typer.echo(f"note: {file} has no target", err=True)
    elif not as_json:
        typer.echo(f"{len(found)} target{'s' * (len(found) > 1)}, {confirmed} confirmed", err=True)


def convert(
    file: Annotated[
        Path,
        typer.Argument(
            help="JSON lines from tracksink; or its CSV, or MOT text, which hold less. - is the standard "
            "input, with JSON lines.",
            exists=True,
            dir_okay=False,
            readable=True,
            allow_dash=True,
        ),
    ],
    output: Annotated[
        Path, typer.Argument(help=f"File to write: {ENDINGS}; .txt is MOT. - is the standard output.")
    ],
    file_format: Annotated[
        FileFormat | None,
        typer.Option("--format", help="Instead of the suffix's; for -, jsonl."),
    ] = None,
    run: RunOption = None,
    points: Annotated[
        bool, typer.Option("--points", help="In GeoJSON and KML, points in place of a line for each target.")
    ] = False,
) -> None:
    """Converts the tracks of a finished run to another format, by the suffix of the output."""
    kind = file_format or ("jsonl" if str(output) == STANDARD_OUTPUT else FORMATS.get(output.suffix.lower()))
    if kind is None:
        rule = f"the name must end in {ENDINGS}, it ends in {output.suffix!r}; or give --format"
        exit_with_error(f"{output}: {rule}")
    sink = "mcapsink" if kind == "mcap" else f"tracksink format={kind} points={points}"
    try:
        with until_reader_leaves(), named_file(file) as path, json_lines(path) as records:
            number = choose_run(records, run, file)
            if kind == "parquet":
                write_parquet(records, number, output)
            else:
                write_records(records, number, sink, output)
    except (OSError, StreamkitError) as error:
        exit_with_error(reason(error))


@contextlib.contextmanager
def json_lines(file: Path) -> Iterator[Path]:
    """The records of a file as JSON lines: the file itself, or a temporary one; notes what the file lacks.

    Raises:
        OSError: a file cannot be read or written.
        StreamError: it is not what its suffix says; only where that is CSV or MOT text.
    """
    suffix = file.suffix.lower()
    if suffix not in READERS:
        if suffix in FORMATS and suffix != ".jsonl":
            exit_with_error(f"{file}: {suffix} cannot be read; give one of .jsonl, {', '.join(READERS)}")
        yield file
        return
    typer.echo(f"note: {file}: {MISSING[suffix]}", err=True)
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder, file.with_suffix(".jsonl").name)
        write_lines(file, lines)
        yield lines


def write_records(file: Path, run: int, sink: str, output: Path) -> None:
    """Writes a run of JSON lines by a sink, and prints its warnings.

    Raises:
        StreamkitError: a file cannot be read or written.
    """
    warnings: list[str] = []
    with Pipeline.parse(f"tracksrc name=records ! {sink} name=output") as pipeline:
        pipeline["records"].location, pipeline["records"].run = str(file), run
        pipeline["output"].location = str(output)
        pipeline.bus.watch(
            lambda message: warnings.append(message.text) if message.kind is MessageKind.WARNING else None
        )
        pipeline.run()
    for text in warnings:
        typer.echo(f"warning: {text}", err=True)


def write_parquet(file: Path, run: int, output: Path) -> None:
    """Writes a row per target and frame, the columns of `read_tracks`; unknown times are null.

    Raises:
        ResourceError: pyarrow is not installed, or the file cannot be written.
    """
    with needs_extra("convert", "parquet"):
        import pyarrow as arrow
        from pyarrow import parquet
    rows = read_tracks(file)
    rows = rows[rows["run"] == run]
    found = io.BytesIO()
    columns = {
        name: arrow.array(rows[name], mask=rows[name] == NO_TIME if name in TIMES else None)
        for name in rows.dtype.names or ()
    }
    parquet.write_table(arrow.table(columns), found)
    write_output(output, found.getvalue())


def list_targets(records: RecordFile) -> list[TargetSummary]:
    """The targets, by run and id."""
    found: dict[tuple[int, int], TargetSummary] = {}
    sizes: defaultdict[tuple[int, int], list[tuple[float, float]]] = defaultdict(list)
    for run, record in records:
        for target in record.tracks:
            row = found.setdefault((run, target.id), TargetSummary(run, target.id))
            row.states[target.state.value] += 1
            sizes[run, target.id].append((target.length, target.width))
            is_there = target.state is not TrackState.LOST or row.last_s is None
            if record.pts_ns is not None and is_there:
                row.last_s = record.pts_ns / 1e9
                row.first_s = row.last_s if row.first_s is None else row.first_s
    for key, row in found.items():
        row.length_px, row.width_px = map(median, zip(*sizes[key], strict=True))
    return [found[key] for key in sorted(found)]


def table_lines(found: list[TargetSummary]) -> list[str]:
    """Lines of the table, 80 columns wide; with the run where there are several."""
    several = any(target.run > 1 for target in found)
    states = [state.value for state in TrackState]
    head = f"{'id':>5} {'from s':>8} {'to s':>8} {'frames':>6} {'size px':>11} {' '.join(states)}"
    lines = [f"run {head}" if several else head]
    for target in found:
        first, last = (
            "-" if seconds is None else f"{seconds:.2f}" for seconds in (target.first_s, target.last_s)
        )
        size = f"{target.length_px:.1f}x{target.width_px:.1f}"
        counts = " ".join(f"{target.states[state]:>{len(state)}}" for state in states)
        line = f"{target.id:>5} {first:>8} {last:>8} {target.states.total():>6} {size:>11} {counts}"
        lines.append(f"{target.run:>3} {line}" if several else line)
    return lines
