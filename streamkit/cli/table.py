"""Statistics as tables or a line: rates and load of each element and process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.cli.summary import dropped_text

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from streamkit.flow.statistics import ElementStatistics, QueueLevels, RunStatistics

COLUMNS = ("element", "in", "out", "rate", "dropped", "errors", "busy", "queue", "age")
PROCESS_COLUMNS = ("process", "cpu", "load", "memory", "frames", "crossings", "waited")
HEADS = {"rate": "/s", "queue": "queue (most)"}  # where they differ from the names
TEXTS = ("element", "dropped", "process")


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
