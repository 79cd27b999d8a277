"""Output of `streamkit subscribe`: lines of text, lines of JSON, or a live table."""

from __future__ import annotations

import sys
import time
from statistics import median, quantiles
from typing import TYPE_CHECKING, Self

from typing_extensions import override

from streamkit import TrackRecord, TrackState, encode_record

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Group

    from streamkit_zenoh.subscriber import TrackSubscriber

REDRAW_EVERY_S = 0.1
# Ages kept for the totals at the end: an hour at 30 records a second.
AGE_LIMIT = 108_000
TOTALS = ("received", "lost", "overwritten", "bad", "restarts", "interleaved", "jumps")


class Printer:
    """Prints records as lines to stdout, and warnings to stderr.

    Args:
        subscriber: whose records they are.
        line: makes the line of a record and its age on arrival, ms or None.
        gaps: whether losses are reported to stderr.
        age: whether the age of each record on arrival is printed, and at the end their median.
    """

    def __init__(
        self,
        subscriber: TrackSubscriber,
        line: Callable[[TrackRecord, float | None], str],
        gaps: bool,
        age: bool,
    ) -> None:
        self._subscriber, self._line = subscriber, line
        self._gaps, self._age = gaps, age
        self._missed = 0
        self._warned: set[str] = set()
        self._ages_ms: list[float] = []

    def show(self, record: TrackRecord) -> None:
        """Prints a record that was just received."""
        sys.stdout.write(self._line(record, self._note_age(record)) + "\n")
        sys.stdout.flush()

    def refresh(self) -> None:
        """Reports records lost since the last call, and once that numbers jump."""
        self._warn()
        before, self._missed = self._missed, missed(self._subscriber)
        if self._gaps and self._missed > before:
            _report(f"gap: {self._missed - before} records missed, {self._missed} in all")

    def note(self, text: str) -> None:
        """Prints a note to stderr."""
        _report(f"note: {text}")

    def _warn(self) -> None:
        for text in set(self._subscriber.warnings()) - self._warned:
            self._warned.add(text)
            _report(f"warning: {text}")

    def _note_age(self, record: TrackRecord) -> float | None:
        """The age on arrival, if it is to be reported."""
        age_ms = arrival_age_ms(record, time.time_ns()) if self._age else None
        if age_ms is not None and len(self._ages_ms) < AGE_LIMIT:
            self._ages_ms.append(age_ms)
        return age_ms

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.refresh()
        self._report_totals()

    def _report_totals(self) -> None:
        if self._gaps:
            counts = self._subscriber.counts
            _report(", ".join(f"{name} {getattr(counts, name)}" for name in TOTALS))
        if len(self._ages_ms) > 1:
            last = quantiles(self._ages_ms, n=100)[98]
            _report(f"age on arrival: median {median(self._ages_ms):.1f} ms, 99th percentile {last:.1f} ms")


class TablePrinter(Printer):
    """A table with a row per target: the newest record's, live, or with `each` that of every record."""

    def __init__(self, subscriber: TrackSubscriber, gaps: bool, age: bool, each: bool) -> None:
        from rich.live import Live

        super().__init__(subscriber, as_text, gaps, age)
        self._live = Live(auto_refresh=False, transient=each)
        self._each = each
        self._shown: tuple[TrackRecord, float | None] | None = None
        self._drawn_s = 0.0

    @override
    def show(self, record: TrackRecord) -> None:
        self._shown = record, self._note_age(record)
        if self._each:
            self._live.update("")
            self._live.console.print(self._table(*self._shown))

    @override
    def refresh(self) -> None:
        if time.monotonic() - self._drawn_s > REDRAW_EVERY_S:
            self._drawn_s = time.monotonic()
            self._draw()

    @override
    def note(self, text: str) -> None:
        self._live.console.print(f"note: {text}", markup=False)  # above the table

    def _draw(self) -> None:
        if self._shown is None:
            there = (
                "a publisher is there" if self._subscriber.counts.publishers else "no publisher is there yet"
            )
            self._live.update(f"waiting for a record: {there}", refresh=True)
        elif not self._each:
            self._live.update(self._table(*self._shown), refresh=True)

    def _table(self, record: TrackRecord, age_ms: float | None) -> Group:
        return as_table(record, age_ms, missed(self._subscriber) if self._gaps else None)

    @override
    def __enter__(self) -> Self:
        self._live.start()
        return self

    @override
    def __exit__(self, *error: object) -> None:
        if self._shown is not None:
            self._draw()
        self._live.stop()
        self._warn()
        self._report_totals()


def printer_for(
    output_format: str, subscriber: TrackSubscriber, gaps: bool, age: bool, each: bool
) -> Printer:
    """The printer of a format: `jsonl`, or `text`, which on a terminal is a table, see `TablePrinter`."""
    if output_format == "jsonl":
        return Printer(subscriber, as_json, gaps, age)
    if sys.stdout.isatty():
        return TablePrinter(subscriber, gaps, age, each)
    return Printer(subscriber, as_text, gaps, age)


def _report(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def missed(subscriber: TrackSubscriber) -> int:
    """Number of records lost, or dropped here."""
    return subscriber.counts.lost + subscriber.counts.overwritten


def arrival_age_ms(record: TrackRecord, now_ns: int) -> float | None:
    """Time since the capture of a live frame, else since publishing; None if the record has neither."""
    began_ns = record.published_ns if record.age_ms is None else record.capture_ns
    return None if began_ns is None else (now_ns - began_ns) / 1e6


def as_json(record: TrackRecord, age_ms: float | None = None) -> str:
    """A record as a line of JSON, its age on arrival as one more field, `arrival_age_ms`."""
    text = encode_record(record).decode()
    return text if age_ms is None else f'{text[:-1]},"arrival_age_ms":{age_ms:.3f}}}'


def as_text(record: TrackRecord, age_ms: float | None = None) -> str:
    """A line for the record and an indented one for each target, without tentative targets."""
    time_s = f"{record.pts_ns / 1e9:8.3f} s" if record.pts_ns is not None else "       ? s"
    rows = [
        f"  #{track.id} {track.state} ({track.x:.1f}, {track.y:.1f}) {track.length:.0f}x{track.width:.0f} px"
        for track in record.tracks
        if track.state is not TrackState.TENTATIVE
    ]
    age = "" if age_ms is None else f"  age {age_ms:.1f} ms"
    return "\n".join([f"{record.source} seq {record.seq} {time_s}{age}  {len(rows)} tracks", *rows])


def as_table(record: TrackRecord, age_ms: float | None = None, missed: int | None = None) -> Group:
    """A title and a table of 80 columns, a row per target, without tentative ones: px, px/s, s."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    shown = [track for track in record.tracks if track.state is not TrackState.TENTATIVE]
    title = f"{record.source}  seq {record.seq}"
    title += "" if record.pts_ns is None else f"  {record.pts_ns / 1e9:.3f} s"
    title += "" if age_ms is None else f"  age {age_ms:.1f} ms"
    title += "" if missed is None else f"  missed {missed}"
    title += f"  {len(shown)} tracks"
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("id", "state", "x", "y", "size", "vx", "vy", "score", "age", "place"):
        table.add_column(name, justify="left" if name == "state" else "right", no_wrap=True)
    for track in shown:
        speeds = ("" if speed is None else str(round(speed)) for speed in (track.vx, track.vy))
        geo = "" if track.geo is None else f"{track.geo.lat:.5f} {track.geo.lon:.5f}"
        place = f"{track.x:.0f}", f"{track.y:.0f}", f"{track.length:.0f}x{track.width:.0f}", *speeds
        table.add_row(
            str(track.id), str(track.state), *place, f"{track.score:.2f}", f"{track.age_ns / 1e9:.0f}", geo
        )
    return Group(Text(title, "italic", no_wrap=True, overflow="ellipsis"), *([table] if shown else []))
