"""`streamkit subscribe`: prints tracks as they come from zenoh."""

from __future__ import annotations

import enum
import signal
import sys
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from streamkit.errors import StateError, StreamkitError

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame

LOOK_EVERY_S = 0.2


class RecordFormat(enum.StrEnum):
    """How a record is printed."""

    TEXT = "text"
    JSONL = "jsonl"


def subscribe(
    key: Annotated[str, typer.Argument(help="What zenohsink was given as key=, for example uav/1.")],
    connect: Annotated[str | None, typer.Option(help="Endpoint to connect to, tcp/HOST:PORT.")] = None,
    form: Annotated[
        RecordFormat, typer.Option("--format", help="How to print a record.")
    ] = RecordFormat.TEXT,
    count: Annotated[int | None, typer.Option(min=1, help="Records to print before leaving.")] = None,
    timeout: Annotated[
        float | None, typer.Option(min=0.0, help="Leave with 1 after so many s of silence.")
    ] = None,
) -> None:
    """Prints the tracks that a zenohsink publishes, until it ends, Ctrl-C, the count or the timeout."""
    from streamkit.graph.pipeline import Pipeline

    pipeline = Pipeline.parse("zenohsrc name=source ! appsink name=out max-buffers=4096")
    pipeline["source"].set_property("key", key)
    if connect:
        pipeline["source"].set_property("connect", connect)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        pipeline.play()
        code = _print_all(pipeline["out"], form, count, timeout, stopped)
    except (StreamkitError, BrokenPipeError) as error:
        typer.echo(f"error: {error}", err=True)
        code = 1
    finally:
        pipeline.stop()
    raise typer.Exit(code)


def _print_all(
    out: Any, form: RecordFormat, count: int | None, timeout_s: float | None, stopped: list[int]
) -> int:
    printed, heard_s = 0, time.monotonic()
    while not stopped and (count is None or printed < count):
        try:
            frame = out.pull(timeout_s=LOOK_EVERY_S)
        except StateError:
            if timeout_s is not None and time.monotonic() - heard_s > timeout_s:
                typer.echo(f"error: no record has come within {timeout_s:g} s", err=True)
                return 1
            continue
        if frame is None:
            break
        heard_s = time.monotonic()
        printed += 1
        sys.stdout.write(as_line(frame, form) + "\n")
        sys.stdout.flush()
    return 0


def as_line(frame: Frame, form: RecordFormat) -> str:
    """A record as one line: the JSON itself, or words for people."""
    text = bytes(frame.data).decode("utf-8")
    if form is RecordFormat.JSONL:
        return text
    from streamkit.flow.record import decode_record

    record = decode_record(frame.data)
    time_s = f"{record.pts_ns / 1e9:8.3f} s" if isinstance(record.pts_ns, int) else "       ? s"
    rows = [
        f"#{track.id} {track.state} ({track.x:.1f}, {track.y:.1f}) {track.length:.0f}x{track.width:.0f} px"
        for track in record.tracks
        if track.state != "tentative"
    ]
    return f"{record.source} seq {record.seq} {time_s}  {len(rows)} tracks  {'  '.join(rows)}".rstrip()
