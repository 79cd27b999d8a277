"""Lines on stderr, text or JSON objects for programs that collect logs, and the ends of commands."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections.abc import Container, Iterator
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Literal, NoReturn

import typer

from streamkit.errors import DescriptionError, StreamkitError
from streamkit.masking import presentable
from streamkit.output.colour import coloured

USAGE_EXIT = 2
LogFormat = Literal["text", "timed", "json"]  # timed begins with the time
_IS_JSON = ContextVar("is_json", default=False)


@contextlib.contextmanager
def lines_in(*, is_json: bool) -> Iterator[None]:
    """Context of a command in which `print_line` prints JSON objects, or text."""
    token = _IS_JSON.set(is_json)
    try:
        yield
    finally:
        _IS_JSON.reset(token)


def print_line(line: str, form: LogFormat | None = None, names: Container[str] = (), **facts: object) -> None:
    """Prints a line on stderr, in the form of the command unless given; for JSON see `as_json`."""
    form = form or ("json" if prints_json() else "text")
    text = coloured(presentable(as_json(line, names, **facts) if form == "json" else line))
    typer.echo(time_stamp() + text if form == "timed" else text, err=True)


def time_stamp() -> str:
    """The time (UTC) with which a timed line begins."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z "


def exit_with_error(text: str, code: int = 1) -> NoReturn:
    """Prints an error on stderr, and ends the command with an exit code."""
    print_line(f"error: {text}")
    raise typer.Exit(code)


def open_threads() -> list[threading.Thread]:
    """The threads that keep the process from ending."""
    return [t for t in threading.enumerate() if t is not threading.main_thread() and not t.daemon]


def end_process(code: int) -> NoReturn:
    """Ends the command with an exit code, even if a library has left a thread that does not end."""
    if open_threads():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    raise typer.Exit(code)


def fail_usage(message: str) -> NoReturn:
    """Ends the command with a usage error."""
    exit_with_error(message, USAGE_EXIT)


def fail(error: StreamkitError) -> NoReturn:
    """Ends the command with an error of streamkit's own: code 2 if it is in what the user wrote."""
    exit_with_error(str(error), USAGE_EXIT if isinstance(error, DescriptionError) else 1)


def prints_json() -> bool:
    """Whether `print_line` prints JSON objects."""
    return _IS_JSON.get()


def as_json(line: str, names: Container[str] = (), **facts: object) -> str:
    """The JSON object of a line: time, level, element and message.

    Args:
        line: "level: text", or "level: element: text"; without a level it is a note.
        names: of the elements.
        facts: further items of the object.
    """
    level, separator, message = line.partition(": ")
    if not separator or not level.isidentifier():
        level, message = "note", line
    source, separator, text = message.partition(": ")
    name = source.partition(" (")[0]  # an error names the factory, too
    element = {"element": name} if separator and name in names else {}
    found = {
        "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "level": level,
        **element,
        "message": text if element else message,
        **facts,
    }
    return json.dumps(found, ensure_ascii=False)
