"""`streamkit launch`: builds a pipeline and runs it until EOS, error or Ctrl-C."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from streamkit.cli.description import (
    DescriptionArgument,
    FileOption,
    SettingsOption,
    fail_description,
    read_description,
)
from streamkit.errors import DescriptionError, StateError, StreamkitError
from streamkit.flow.messages import Message, MessageKind

if TYPE_CHECKING:
    from streamkit.graph.pipeline import Pipeline

LOOK_EVERY_S = 0.2
EOS_LIMIT_S = 10.0


def launch(
    description: DescriptionArgument = None,
    file: FileOption = None,
    settings: SettingsOption = None,
    eos: Annotated[
        bool, typer.Option("-e", "--eos-on-shutdown", help="Ctrl-C sends EOS and waits for it.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Print every message and the caps.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors.")] = False,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print counters of every element at the end.")
    ] = False,
    json_errors: Annotated[
        bool, typer.Option("--json-errors", help="Print a bad description as JSON.")
    ] = False,
) -> None:
    """Runs a pipeline until EOS, error or Ctrl-C.

    Exit code 0 at EOS or a clean stop, 1 when the pipeline fails, 2 for a bad description or usage.
    """
    from streamkit.graph.pipeline import Pipeline

    source = read_description(description, file, settings or [])
    try:
        pipeline = Pipeline.parse(source.text, source.variables)
    except DescriptionError as error:
        fail_description(error, source, as_json=json_errors)
    code = Run(pipeline, eos_on_shutdown=eos, verbose=verbose, quiet=quiet).run()
    if stats:
        for row in pipeline.statistics():
            typer.echo(json.dumps({name: getattr(row, name) for name in row.__struct_fields__}))
    _leave(code)


def _leave(code: int) -> NoReturn:
    """Ends the process, even where a library has left a thread that does not end."""
    left = [t for t in threading.enumerate() if t is not threading.main_thread() and not t.daemon]
    if left:
        typer.echo(f"error: threads did not end: {', '.join(t.name for t in left)}", err=True)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code or 1)
    raise typer.Exit(code)


class Run:
    """One run of a pipeline, watched from the main thread."""

    def __init__(self, pipeline: Pipeline, *, eos_on_shutdown: bool, verbose: bool, quiet: bool) -> None:
        self.pipeline = pipeline
        self.eos_on_shutdown = eos_on_shutdown
        self.verbose = verbose
        self.quiet = quiet
        self.interrupts = 0
        self.progress = Progress(pipeline) if sys.stderr.isatty() and not quiet else None

    def run(self) -> int:
        """Plays to the end and stops; the exit code."""
        code = 0
        if not self.quiet:
            for _, text in self.pipeline.graph.warnings:
                self.tell(f"note: {text}")
        with self._signals():
            try:
                self.pipeline.play()
                code = self._watch()
            except StreamkitError as error:
                code = self._fail(str(error))
            finally:
                try:
                    self.pipeline.stop()
                except StateError as error:
                    code = self._fail(str(error))
        self._tell_rest()
        return code

    def _watch(self) -> int:
        """Follows the bus until the end."""
        deadline: float | None = None
        handled = 0
        while True:
            message = self.pipeline.bus.pop(LOOK_EVERY_S)
            if self.progress is not None:
                self.progress.show()
            if message is not None:
                self._tell_message(message)
                if message.kind is MessageKind.ERROR:
                    return self._fail(message.text)
                if message.kind is MessageKind.EOS:
                    return 0
            if self.interrupts > handled:
                handled = self.interrupts
                if not self.eos_on_shutdown or handled > 1:
                    return 0
                self.pipeline.finish()
                deadline = time.monotonic() + EOS_LIMIT_S
            if deadline is not None and time.monotonic() > deadline:
                return self._fail(f"EOS has not come through within {EOS_LIMIT_S:g} s of the interrupt")

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        """Counts Ctrl-C and SIGTERM while the pipeline runs; the third ends the process at once."""

        def interrupted(number: int, _: object) -> None:
            self.interrupts += 1
            if self.interrupts > 2:
                os._exit(128 + number)

        before = {number: signal.signal(number, interrupted) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _tell_rest(self) -> None:
        """Shows what was posted while stopping."""
        while (message := self.pipeline.bus.pop(0.0)) is not None:
            if message.kind is not MessageKind.ERROR:
                self._tell_message(message)
        if self.progress is not None:
            self.progress.end()

    def _tell_message(self, message: Message) -> None:
        if message.kind is MessageKind.WARNING and not self.quiet:
            self.tell(f"warning: {message.source}: {message.text}")
        elif self.verbose and message.kind is not MessageKind.ERROR:
            fields = " ".join(f"{name}={value}" for name, value in message.fields.items() if name != "name")
            self.tell(f"{message.kind}: {message.source or 'pipeline'}: {message.text} {fields}".rstrip())

    def _fail(self, text: str) -> int:
        self.tell(f"error: {text}")
        return 1

    def tell(self, line: str) -> None:
        """Prints a line on stderr, above the progress line."""
        if self.progress is not None:
            self.progress.clear()
        typer.echo(line, err=True)


class Progress:
    """A line on the terminal that tells how far the pipeline is."""

    def __init__(self, pipeline: Pipeline) -> None:
        self.pipeline = pipeline
        self.began_s = time.monotonic()
        self.shown = False

    def show(self) -> None:
        """Draws the line anew."""
        rows = self.pipeline.statistics()
        frames = max((row.frames_in for row in rows), default=0)
        dropped = sum(sum(row.dropped.values()) for row in rows)
        elapsed_s = time.monotonic() - self.began_s
        rate = frames / elapsed_s if elapsed_s > 0 else 0.0
        lost = f", {dropped} dropped" if dropped else ""
        sys.stderr.write(f"\r\x1b[K{elapsed_s:7.1f} s  {frames} frames  {rate:.1f}/s{lost}")
        sys.stderr.flush()
        self.shown = True

    def clear(self) -> None:
        """Takes the line away, for another to be printed."""
        if self.shown:
            sys.stderr.write("\r\x1b[K")
            self.shown = False

    def end(self) -> None:
        """Leaves the last state of the line standing."""
        self.show()
        sys.stderr.write("\n")
