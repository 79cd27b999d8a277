"""Displays of `launch`: lines, on a terminal also a progress line or a table."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Literal

from typing_extensions import override

from streamkit.cli.stderr import LogFormat, print_line, time_stamp
from streamkit.cli.summary import age_text, as_line, as_tables, summarise
from streamkit.flow.statistics import RunStatistics
from streamkit.masking import presentable

if TYPE_CHECKING:
    from rich.live import Live

    from streamkit.graph.pipeline import Pipeline

REDRAW_EVERY_S = 0.2
LINE_EVERY_S = START_EVERY_S = 1.0
SHARE_OF_BAR, MIN_BAR_COLUMNS = 0.25, 8  # of the columns; columns


class Display:
    """Prints lines; base class of the displays of a terminal.

    Args:
        pipeline: whose counters it shows.
        counters: "lines" prints them as a line every second and as a table at the end, "end" only then.

    Attributes:
        every_s: minimum interval between updates, s.
        form: of the lines: text, timed text, or JSON objects (time, level, element, message) for programs.
        before: the counters since which rates are shown.
    """

    every_s = REDRAW_EVERY_S
    form: LogFormat = "text"

    def __init__(self, pipeline: Pipeline, counters: Literal["", "end", "lines"] = "") -> None:
        self.pipeline = pipeline
        self.began_s = self._drawn_s = time.monotonic()
        self.before: RunStatistics | None = None
        self._counters = counters
        if counters == "lines":
            self.every_s = LINE_EVERY_S

    def starting(self) -> AbstractContextManager[object]:
        """Held while elements start, which compiles loops once on a machine; shows nothing."""
        return contextlib.nullcontext()

    def begin(self) -> None:
        """Counts the time from now on: before, elements have started, and perhaps compiled loops."""
        self.began_s = self._drawn_s = time.monotonic()

    def measure(self) -> RunStatistics:
        """Current statistics."""
        return RunStatistics(
            elapsed_s=round(time.monotonic() - self.began_s, 3),
            elements=self.pipeline.statistics(),
            processes=self.pipeline.process_statistics(),
        )

    def show(self) -> None:
        """Redraws if the interval has passed."""
        now_s = time.monotonic()
        if now_s - self._drawn_s >= self.every_s:
            self._drawn_s = now_s
            self.draw()

    def draw(self) -> None:
        """Redraws the display."""
        if self._counters == "lines":
            now = self.measure()
            self.print_line(as_line(now, self.before))
            self.before = now

    def print_line(self, line: str) -> None:
        """Prints a line on stderr, above the display."""
        print_line(line, self.form, [element.name for element in self.pipeline.graph.elements])

    def end(self, whole: RunStatistics) -> None:
        """Draws the final state, with the statistics of the whole run."""
        if self._counters:
            from rich.console import Console

            Console(stderr=True, width=160).print(as_tables(whole))

    def abandon(self) -> None:
        """Restores the terminal before the process ends at once."""


class Progress(Display):
    """A progress line on the terminal, of a file with a bar."""

    shown = False
    _frames = 0
    _frames_s = 0.0

    def __init__(self, pipeline: Pipeline) -> None:
        super().__init__(pipeline)
        self._writing = Lock()  # while elements start, lines come from another thread

    @contextlib.contextmanager
    @override
    def starting(self) -> Iterator[None]:
        has_started = Event()
        thread = Thread(target=self._count_start, args=(has_started,), name="progress of the start")
        thread.start()
        try:
            yield
        finally:
            has_started.set()
            thread.join()
            self._clear()

    def _count_start(self, has_started: Event) -> None:
        while not has_started.wait(START_EVERY_S):
            with self._writing:
                self._show(f"{time.monotonic() - self.began_s:7.1f} s  starting")

    @override
    def draw(self) -> None:
        now = self.measure()
        frames = max((row.frames_in for row in now.elements), default=0)
        since_s = now.elapsed_s - self._frames_s
        rate = (frames - self._frames) / since_s if since_s > 0 else 0.0
        self._frames, self._frames_s = frames, now.elapsed_s
        share, where = self._position(now.elapsed_s)
        words = [f"{where}  {frames} frames  {rate:.1f}/s"]
        if dropped := summarise(now).dropped:
            words.append(f"{dropped} dropped")
        ages_ns = [row.age_ns for row in now.elements if row.age_ns is not None and not row.frames_out]
        if ages_ns and self.pipeline.is_live:
            words.append(f"{age_text(max(ages_ns))} old")
        text, columns = ", ".join(words), shutil.get_terminal_size().columns - 1
        width = min(columns - len(text), round(columns * SHARE_OF_BAR))
        if share is not None and width >= MIN_BAR_COLUMNS:
            line = bar(share, width) + text
        else:
            line = f"{now.elapsed_s:7.1f} s{text}"[:columns]
        self._show(line)

    def _show(self, line: str) -> None:
        sys.stderr.write(f"\r{line}\x1b[K")
        sys.stderr.flush()
        self.shown = True

    def _clear(self) -> None:
        if self.shown:
            sys.stderr.write("\r\x1b[K")
            self.shown = False

    def _position(self, elapsed_s: float) -> tuple[float | None, str]:
        """How much of a file is done, and how long the rest takes at the rate so far."""
        position, duration = self.pipeline.position_ns(), self.pipeline.duration_ns()
        if not position or not duration or position > duration:
            return None, ""
        minutes, seconds = divmod(round(elapsed_s * (duration - position) / position), 60)
        left = f"{minutes}:{seconds:02d} left"
        share = position / duration
        return share, f"  at {position / 1e9:.1f} of {duration / 1e9:.1f} s ({100 * share:.0f} %, {left})"

    def print_line(self, line: str) -> None:
        """Prints a line in place of the progress line, which is redrawn below."""
        with self._writing:
            self._clear()
            super().print_line(line)


def bar(share: float, width: int) -> str:
    """A bar of `width` columns for the terminal at stderr: in its colours, of the characters that it has."""
    from rich.console import Console
    from rich.progress_bar import ProgressBar

    console = Console(stderr=True)
    with console.capture() as drawn:
        console.print(ProgressBar(total=1.0, completed=share, width=width), end="")
    return drawn.get()


class Table(Display):
    """A table on the terminal, redrawn in place, with rates over about the last second."""

    _live: Live | None = None

    @override
    def draw(self) -> None:
        now = self.measure()
        self._update(now, self.before)
        if self.before is None or now.elapsed_s - self.before.elapsed_s >= LINE_EVERY_S:
            self.before = now

    def abandon(self) -> None:
        """Shows the cursor, which the table hides."""
        if self._live is not None:
            os.write(sys.stderr.fileno(), b"\x1b[?25h\n")

    def _update(self, now: RunStatistics, before: RunStatistics | None) -> None:
        from rich.console import Console
        from rich.live import Live

        if self._live is None:
            self._live = Live(
                console=Console(stderr=True),
                auto_refresh=False,  # without its own thread
                redirect_stdout=False,
                redirect_stderr=False,
            )
            self._live.start()
        self._live.update(as_tables(now, before), refresh=True)

    def print_line(self, line: str) -> None:
        """Prints a line above the table."""
        if self._live is None:
            super().print_line(line)
        else:
            stamp = time_stamp() if self.form == "timed" else ""
            self._live.console.print(stamp + presentable(line), markup=False, highlight=False)

    @override
    def end(self, whole: RunStatistics) -> None:
        self._update(whole, None)
        if self._live is not None:
            self._live.stop()
