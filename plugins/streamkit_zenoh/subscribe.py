"""`streamkit subscribe`: prints tracks received from zenoh."""

from __future__ import annotations

import enum
import signal
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from streamkit import end_process, exit_with_error, write_remedy
from streamkit.output.pipe import until_reader_leaves
from streamkit_zenoh.silence import SilenceMonitor, others_text

if TYPE_CHECKING:
    from streamkit_zenoh.subscribe_output import Printer
    from streamkit_zenoh.subscriber import TrackSubscriber

POLL_S = 0.2
RETURN_LIMIT_S = 2.0  # a link that was cut is back within it, as after this process was suspended
MAX_RECORDS = 4096
VANISHED = (
    "the publisher has gone without ending its stream: killed, or the way to it is cut; "
    "--stay waits for the next one"
)


class PrintFormat(enum.StrEnum):
    """How records are printed."""

    TEXT = "text"
    JSONL = "jsonl"


def subscribe(
    key: Annotated[str, typer.Argument(help="The key of zenohsink, for example uav/1.")],
    connect: Annotated[str | None, typer.Option(help="Endpoint to connect to, tcp/HOST:PORT.")] = None,
    listen: Annotated[str | None, typer.Option(help="Endpoint to listen on, tcp/0.0.0.0:7447.")] = None,
    mode: Annotated[Literal["auto", "peer", "client"], typer.Option(help="Role of the session.")] = "auto",
    config: Annotated[
        str | None, typer.Option(help="zenoh configuration file, for TLS and passwords.")
    ] = None,
    form: Annotated[
        PrintFormat,
        typer.Option("--format", help="text: a live table, or lines when piped; jsonl: a line per record."),
    ] = PrintFormat.TEXT,
    count: Annotated[int | None, typer.Option(min=1, help="Records to print before the end.")] = None,
    timeout: Annotated[
        float | None, typer.Option(min=0.0, help="End with exit code 1 after so many s without a record.")
    ] = None,
    gaps: Annotated[bool, typer.Option("--gaps", help="Report lost records, and totals at the end.")] = False,
    age: Annotated[bool, typer.Option("--age", help="Report the age of records on arrival.")] = False,
    newest: Annotated[bool, typer.Option("--newest", help="Skip to the newest record when slow.")] = False,
    stay: Annotated[
        bool, typer.Option("--stay", help="Wait for the next publisher when one is gone.")
    ] = False,
) -> None:
    """Prints the tracks that a zenohsink publishes, until its end, Ctrl-C, the count or the timeout.

    Exit code 0 at the end of the stream, the count or an interrupt; 1 at the timeout, or if the publisher
    is gone without ending its stream: killed, or the router between lost.
    """
    from streamkit_zenoh.subscribe_output import printer_for
    from streamkit_zenoh.subscriber import TrackSubscriber

    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        subscriber = TrackSubscriber(
            key,
            connect=connect,
            listen=listen,
            mode=mode,
            config=config,
            ring=1 if newest else MAX_RECORDS,
            ends_with_publisher=not stay,
        )
    except ValueError as error:
        exit_with_error(str(error), 2)
    except OSError as error:
        exit_with_error(str(error))
    code, message = 0, ""
    try:
        opened = printer_for(form.value, subscriber, gaps, age, count is not None)
        with until_reader_leaves(), opened as printer:
            code, message = _print_all(subscriber, printer, count, timeout, lambda: bool(stopped))
    except OSError as error:
        code, message = 1, f"a record was not printed: {error.strerror}{write_remedy(error)}"
    finally:
        subscriber.close()
    if message:
        typer.echo(f"error: {message}", err=True)
    end_process(code)  # zenoh may have left a thread


def _print_all(
    subscriber: TrackSubscriber,
    printer: Printer,
    count: int | None,
    timeout_s: float | None,
    stopped: Callable[[], bool],
) -> tuple[int, str]:
    """Exit code and error."""
    printed, there_s = 0, time.monotonic()
    silence = SilenceMonitor(
        time.monotonic, lambda: subscriber.counts.publishers > 0, subscriber.published_keys
    )
    while not stopped() and (count is None or printed < count):
        update = subscriber.update(POLL_S)
        printer.refresh()
        is_gone = update is None and subscriber.is_over
        if not is_gone:
            there_s = time.monotonic()
        if update is not None:
            silence.reset()
            if update.record is not None:
                printed += 1
                printer.show(update.record)
        elif is_gone:
            if not subscriber.has_vanished:
                return 0, ""
            if time.monotonic() - there_s > RETURN_LIMIT_S:
                return 1, VANISHED
            time.sleep(POLL_S)
        elif timeout_s is not None and silence.seconds > timeout_s:
            return 1, f"no record has come within {timeout_s:g} s{_remedy(subscriber)}"
        elif reason := silence.reason():
            printer.note(f"no record{reason}")
    return 0, ""


def _remedy(subscriber: TrackSubscriber) -> str:
    if subscriber.counts.publishers:
        return ", though a publisher is there"
    if others := others_text(subscriber.published_keys()):
        return f": {others}"
    return ": no publisher is there; start it, or give both sides endpoints that meet (--connect, --listen)"
