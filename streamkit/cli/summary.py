"""What a run has made: its last line, and its counters as tables, as a line, and as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec
import typer

from streamkit.cli.stderr import exit_with_error
from streamkit.errors import write_remedy
from streamkit.graph.files import user_of
from streamkit.masking import mask_secrets, presentable_value
from streamkit.output.file import check_writable, write_whole
from streamkit.output.pipe import STANDARD_OUTPUT

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from streamkit.cli.display import Display
    from streamkit.cli.run import Run
    from streamkit.flow.statistics import ElementStatistics, QueueLevels, RunStatistics
    from streamkit.graph.pipeline import Pipeline

COLUMNS = ("element", "in", "out", "rate", "dropped", "errors", "busy", "queue", "age")
PROCESS_COLUMNS = ("process", "cpu", "load", "memory", "frames", "crossings", "waited")
HEADS = {"rate": "/s", "queue": "queue (most)"}  # where they differ from the names
TEXTS = ("element", "dropped", "process")
LABELS = {"tracks": "confirmed tracks", "deleted_files": "deleted files"}


@dataclass(frozen=True, slots=True)
class Row:
    """Displayed statistics of an element.

    Attributes:
        counters: since the run began.
        rate: frames/s.
        busy: share of time spent working, 0 to 1.
    """

    counters: ElementStatistics
    rate: float
    busy: float


def measure_rows(now: RunStatistics, before: RunStatistics | None = None) -> list[Row]:
    """Rates and load since earlier statistics, or since the run began."""
    earlier = {row.element: row for row in before.elements} if before is not None else {}
    span_s = now.elapsed_s - (before.elapsed_s if before is not None else 0.0)

    def measure(row: ElementStatistics) -> Row:
        frames, busy_ns = max(row.frames_in, row.frames_out if not row.frames_in else 0), row.busy_ns
        if (old := earlier.get(row.element)) is not None:
            frames -= max(old.frames_in, old.frames_out if not old.frames_in else 0)
            busy_ns -= old.busy_ns
        if span_s <= 0:
            return Row(row, 0.0, 0.0)
        return Row(row, max(0.0, frames / span_s), min(1.0, max(0.0, busy_ns / 1e9 / span_s)))

    return [measure(row) for row in now.elements]


def queue_text(levels: QueueLevels | None) -> str:
    """Queued frames, limit and maximum: "3/200 (12)"."""
    if levels is None:
        return ""
    return f"{levels.buffers}/{levels.limit_buffers or '-'} ({levels.max_buffers})"


def age_text(age_ns: int | None) -> str:
    """Milliseconds, or seconds from 10 s on."""
    if age_ns is None:
        return ""
    return f"{age_ns / 1e6:.0f} ms" if age_ns < 10_000_000_000 else f"{age_ns / 1e9:.0f} s"


def facts(row: Row) -> dict[str, str]:
    """What is printed of an element, by the keys of `COLUMNS`; without what is zero or unknown."""
    counters = row.counters
    found = {
        "in": str(counters.frames_in or ""),
        "out": str(counters.frames_out or ""),
        "rate": f"{row.rate:.1f}",
        "busy": "" if counters.queue is not None else f"{row.busy:.0%}",  # of a queue it is waiting upstream
        "dropped": dropped_text(counters.dropped),
        "errors": str(counters.errors or ""),
        "queue": queue_text(counters.queue),
        "age": age_text(counters.age_ns),
    }
    return {name: text for name, text in found.items() if text}


def process_facts(now: RunStatistics, before: RunStatistics | None) -> list[dict[str, str]]:
    """What is printed of each process, by the keys of `PROCESS_COLUMNS`."""
    earlier = {row.pid: row.cpu_ns for row in before.processes} if before is not None else {}
    span_s = now.elapsed_s - (before.elapsed_s if before is not None else 0.0)
    return [
        {
            "process": row.process,
            "cpu": f"{row.cpu_ns / 1e9:.2f} s",
            "load": f"{(row.cpu_ns - earlier.get(row.pid, 0)) / 1e9 / span_s:.0%}" if span_s > 0 else "",
            "memory": f"{row.rss_bytes / 2**20:.0f} MiB",
            "frames": str(row.frames),
            "crossings": str(row.crossings),
            "waited": f"{row.waited_ns / 1e9:.2f} s",
        }
        for row in now.processes
    ]


def as_tables(now: RunStatistics, before: RunStatistics | None = None) -> Group:
    """A table with one row per element, and one with a row per process."""
    from rich.console import Group

    lines = [
        {"in": "0", "out": "0", **facts(row), "element": row.counters.element}
        for row in measure_rows(now, before)
    ]
    title = f"{now.elapsed_s:.1f} s"
    return Group(_table(COLUMNS, lines, title), _table(PROCESS_COLUMNS, process_facts(now, before)))


def _table(columns: tuple[str, ...], lines: list[dict[str, str]], title: str | None = None) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1, 0, 0))
    for name in columns:
        head = HEADS.get(name, name)
        is_text = name in TEXTS  # folded on a narrow terminal, unlike numbers
        width = 8 if is_text else max(len(text) for text in (head, *(line.get(name, "") for line in lines)))
        table.add_column(head, justify="left" if is_text else "right", no_wrap=not is_text, min_width=width)
    for line in lines:
        table.add_row(*(Text(line.get(name, "")) for name in columns))
    return table


def as_line(now: RunStatistics, before: RunStatistics | None) -> str:
    """All elements in one line: "stats 2.0 s | fakesrc0 out 60 30.0/s busy 1 % | ..."."""
    words = [f"stats {now.elapsed_s:.1f} s"]
    for row in measure_rows(now, before):
        found = [f"{text}/s" if name == "rate" else f"{name} {text}" for name, text in facts(row).items()]
        words.append(" ".join([row.counters.element, *found]))
    for process in process_facts(now, before):
        figures = [f"{name} {text}" for name, text in process.items() if name != "process"]
        words.append(" ".join([process["process"], *figures]))
    return " | ".join(words)


class RunSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A run in short: the JSON of `launch --summary=json`.

    Attributes:
        schema: name and version of the format.
        elapsed_s: since the run began, s.
        frames: that arrived at a sink, most of any; of video if there is some, else of anything.
        dropped: frames not delivered, over all elements.
        reasons: how many of those, by reason.
        results: what elements have made, by name; `tracks` are those that were confirmed.
        files: number of the files written, by location, which is a pattern where there are several.
        incomplete: locations whose last file lacks frames that arrived, because its sink has failed.
    """

    schema: Literal["streamkit.summary/1"] = "streamkit.summary/1"
    elapsed_s: float
    frames: int
    dropped: int
    reasons: dict[str, int] = {}
    results: dict[str, int]
    files: dict[str, int]
    incomplete: list[str] = []


def summarise(statistics: RunStatistics) -> RunSummary:
    """The summary of counters."""
    results: Counter[str] = Counter()
    for row in statistics.elements:
        results.update({name: count for name, count in row.results.items() if name != "files"})
    reasons: Counter[str] = Counter()
    for row in statistics.elements:
        reasons.update(row.dropped)
    sinks = [row for row in statistics.elements if all(pad.direction == "sink" for pad in row.pads)]
    pads = [pad for row in sinks for pad in row.pads]
    video = [pad.frames for pad in pads if (pad.caps or "").startswith("video/")]
    return RunSummary(
        elapsed_s=statistics.elapsed_s,
        frames=max(video, default=0) or max((pad.frames for pad in pads), default=0),
        dropped=reasons.total(),
        reasons=dict(reasons),
        results=dict(results),
        files={row.location: count for row in statistics.elements if (count := row.results.get("files"))},
        incomplete=[row.location for row in statistics.elements if row.location and row.has_failed],
    )


def dropped_text(dropped: Mapping[str, int]) -> str:
    """Total and reasons: "7 (queue full: 5; late: 2)", of one reason "7 (queue full)"; "" for none."""
    if not dropped:
        return ""
    counted = (f"{reason}: {count}" for reason, count in sorted(dropped.items()))
    return f"{sum(dropped.values())} ({'; '.join(counted if len(dropped) > 1 else dropped)})"


def as_text(summary: RunSummary, written: Mapping[str, Sequence[str]] | None = None) -> str:
    """The last line of a run: "30 frames in 1.0 s, 30.0/s, 3 confirmed tracks, wrote tracks.jsonl".

    Args:
        summary: the run.
        written: first and last file by location, in place of patterns.
    """
    words = [f"{summary.frames} frame{'s' * (summary.frames != 1)} in {summary.elapsed_s:.1f} s"]
    if summary.elapsed_s:
        words.append(f"{summary.frames / summary.elapsed_s:.1f}/s")
    if summary.dropped:
        words.append(f"dropped {dropped_text(summary.reasons)}")
    for name, count in summary.results.items():
        label = LABELS.get(name, name)
        words.append(f"{count} {label.removesuffix('s') if count == 1 else label}")
    files = [
        _files_text(count, " to ".join((written or {}).get(name, [name])), is_part=name in summary.incomplete)
        for name, count in summary.files.items()
    ]
    if files:
        words.append(f"wrote {' and '.join(files)}")
    return ", ".join(words)


def _files_text(count: int, names: str, *, is_part: bool) -> str:
    if names == STANDARD_OUTPUT:
        return "to the standard output"
    if count == 1:
        return f"part of {names}" if is_part else names
    return f"{count} files {names}" + (" (the last in part)" if is_part else "")


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
        for text in printer.shortfalls if printer.quiet else ():  # else they were printed as warnings
            printer.say("error", text)
    if stats == "json":
        typer.echo(to_json(statistics))
    made = summarise(statistics)
    if summary == "json":
        typer.echo(to_json(made))
    if stats_file is not None and not _write_counters(stats_file, statistics, display):
        code = 1
    if summary == "text" or (run.has_played and not printer.quiet):
        written = {row.location: row.written for row in statistics.elements if row.written}
        display.print_line(as_text(made, written))
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
