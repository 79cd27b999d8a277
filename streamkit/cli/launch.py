"""`streamkit launch`: builds a pipeline and runs it until EOS, error or Ctrl-C."""

from __future__ import annotations

import contextlib
import gc
import signal
import sys
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer
from typer.core import TyperCommand

from streamkit.cli.commands import parsed_by
from streamkit.cli.description import (
    DescriptionArgument,
    FileOption,
    SettingsOption,
    build_graph,
    read_description,
)
from streamkit.cli.stderr import (
    LogFormat,
    end_process,
    fail,
    fail_usage,
    lines_in,
    open_threads,
    print_line,
)
from streamkit.errors import StreamkitError
from streamkit.handoff.library_threads import share_cores
from streamkit.output.pipe import STANDARD_INPUT
from streamkit.service.signals import handling_signals

if TYPE_CHECKING:
    from streamkit.cli.display import Display
    from streamkit.graph.pipeline import Pipeline
    from streamkit.service.monitor import Monitor


Form = Literal["text", "json"]


class LaunchCommand(TyperCommand):
    """What typer does not support: `--stats` without a value is `=text`; usage errors may be log lines."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Reads the arguments."""
        with usage_errors(is_json="--log-format=json" in args or ("--log-format", "json") in pairwise(args)):
            return self._parse(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Runs the command."""
        with usage_errors(is_json=ctx.params["log_format"] == "json"):
            return super().invoke(ctx)

    def _parse(self, ctx: Any, args: list[str]) -> list[str]:
        """Adds the default value where no value follows, up to `--`."""
        end = args.index("--") if "--" in args else len(args)
        read = [
            f"{arg}=text" if arg in ("--stats", "--summary") and following not in ("text", "json") else arg
            for arg, following in zip(args[:end], [*args[1:end], ""], strict=False)
        ]
        return super().parse_args(ctx, [*read, *args[end:]])


@parsed_by(LaunchCommand)
def launch(
    description: DescriptionArgument = None,
    file: FileOption = None,
    settings: SettingsOption = None,
    eos: Annotated[
        bool, typer.Option("-e", "--eos-on-shutdown", help="Ctrl-C sends EOS and waits for it.")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option("-v", "--verbose", help="Print caps, states, every message, and where code failed."),
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors.")] = False,
    stats: Annotated[
        Form | None,
        typer.Option(
            "--stats",
            metavar="[=json]",
            help="Show counters while it runs; --stats=json prints them as JSON at the end.",
        ),
    ] = None,
    stats_file: Annotated[
        Path | None, typer.Option("--stats-file", help="Write the counters into a JSON file at the end.")
    ] = None,
    summary: Annotated[
        Form | None,
        typer.Option(
            "--summary",
            metavar="[=json]",
            help="Print the last line with -q, too; --summary=json prints it as JSON.",
        ),
    ] = None,
    processes: Annotated[
        Literal["auto"] | None,
        typer.Option(
            "--processes", help="Measure for 5 s, then cut the pipeline into processes of like work."
        ),
    ] = None,
    json_errors: Annotated[
        bool, typer.Option("--json-errors", help="Print a bad description as JSON.")
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit code 1 also if the run lacks what it is for, such as tracks."),
    ] = False,
    watchdog_s: Annotated[
        float,
        typer.Option("--watchdog-s", min=0.0, help="Time limit of an element for a frame, s; 0 is none."),
    ] = 30.0,
    metrics: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="Serve /metrics, /healthz and /readyz, for example at 127.0.0.1:9464."
        ),
    ] = None,
    log_format: Annotated[
        LogFormat,
        typer.Option(
            "--log-format", help="Lines on stderr: timed begin with the time (UTC), json are JSON objects."
        ),
    ] = "text",
    supervise: Annotated[
        bool, typer.Option("--supervise", help="Run in a child; start it again when it fails, with back-off.")
    ] = False,
) -> None:
    """Runs a pipeline until EOS, error or Ctrl-C; the last line says what it has made.

    Exit code 0 at EOS or a clean stop, 1 if the pipeline fails, 2 for a bad description or usage. The
    first interrupt stops cleanly; a further one ends the process at once.
    """
    if supervise:
        if str(file) == STANDARD_INPUT:
            fail_usage("--supervise reads the description again at each start; give a file in place of -f -")
        _supervise(log_format)
    source = read_description(description, file, settings or [])
    with exit_on_interrupt(quiet=quiet):
        with without_collection():
            from streamkit.cli.run import Run
            from streamkit.cli.summary import check_stats_file, print_results
            from streamkit.graph.description_text import unused_variables
            from streamkit.graph.link import open_ends
            from streamkit.graph.pipeline import Pipeline
            from streamkit.service.monitor import Monitor

            pipeline = Pipeline(build_graph(source, as_json=json_errors))
        if processes is not None:
            from streamkit.cli.processes import choose_processes

            source = choose_processes(source, pipeline)
            pipeline = Pipeline(build_graph(source))
            gc.collect()  # the pipeline that was measured
        if stats_file is not None:
            check_stats_file(stats_file, pipeline)
        gc.freeze()  # what the imports have made is not searched again while the elements start
        if pipeline.graph.processes:
            share_cores(len(pipeline.graph.processes) + 1)
        pipeline.watchdog_s = watchdog_s
        display = choose_display(pipeline, stats, log_format, quiet=quiet)
        monitor = Monitor(pipeline)
        run = Run(pipeline, display, eos_on_shutdown=eos, verbose=verbose, quiet=quiet, monitor=monitor)
        for note in (*unused_variables(source.text, source.variables), *open_ends(pipeline.graph)):
            run.printer.say("note", note)
    with serve_metrics(monitor, metrics):
        code = run.run()
    result = print_results(run, stats, stats_file, summary, strict=strict)
    _exit(code or result, abandons_start=run.abandons_start)


@contextlib.contextmanager
def usage_errors(*, is_json: bool) -> Iterator[None]:
    """Context that prints lines as JSON objects if asked to, and usage errors, which else typer prints."""
    with lines_in(is_json=is_json):
        try:
            yield
        except StreamkitError as error:
            fail(error)
        except Exception as error:
            # Typer exports no base class of its usage errors.
            message = getattr(error, "format_message", None)
            from streamkit.element.gstreamer_names import option_hint

            hint = option_hint(getattr(error, "option_name", ""))
            if message is None or not (is_json or hint):
                raise
            fail_usage(f"{message().partition(' (')[0]}; {hint}" if hint else message())


@contextlib.contextmanager
def exit_on_interrupt(*, quiet: bool) -> Iterator[None]:
    """Context in which Ctrl-C, SIGTERM and SIGHUP end the command at once, while the pipeline is built."""
    try:
        with handling_signals(signal.default_int_handler):
            yield
    except KeyboardInterrupt:
        if not quiet:
            print_line("interrupt: stopped before it played")
        raise typer.Exit(0) from None


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Context without garbage collection: there is no garbage among what imports make."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _supervise(log_format: LogFormat) -> NoReturn:
    """Runs this command in a child, without `--supervise`, until it ends cleanly."""
    from streamkit.service.supervisor import STREAMKIT_COMMAND, Supervisor

    words = [word for word in sys.argv[1:] if word != "--supervise"]
    supervisor = Supervisor([*STREAMKIT_COMMAND, *words], partial(print_line, form=log_format))
    raise typer.Exit(supervisor.run())


def serve_metrics(monitor: Monitor, address: str | None) -> contextlib.AbstractContextManager[object]:
    """Context in which metrics are served at an address, if there is one; exits with 2 if they cannot be."""
    if address is None:
        return contextlib.nullcontext()
    from streamkit.errors import ResourceError
    from streamkit.service.endpoint import MetricsEndpoint

    try:
        return MetricsEndpoint(monitor, address)
    except ResourceError as error:
        fail_usage(str(error))


def choose_display(pipeline: Pipeline, stats: Form | None, log_format: LogFormat, *, quiet: bool) -> Display:
    """The display for a terminal, a file or a program."""
    from streamkit.cli.display import Display, Progress, Table

    is_json = log_format == "json"  # counters and progress are for people
    display = Display(pipeline, "" if stats != "text" or is_json else "end" if quiet else "lines")
    if not (quiet or is_json) and sys.stderr.isatty():
        display = Table(pipeline) if stats == "text" else Progress(pipeline)
    display.form = log_format
    return display


def _exit(code: int, *, abandons_start: bool) -> NoReturn:
    """Exits, even if a thread does not end: an error, unless it is that of an interrupted start."""
    if not abandons_start and (left := open_threads()):
        print_line(f"error: threads did not end: {', '.join(thread.name for thread in left)}")
        code = code or 1
    end_process(code)
