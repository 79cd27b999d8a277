"""The command `streamkit`: imports only the requested command, for a fast start.

This module has no slow imports, so that Ctrl-C is handled from the beginning.
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import typer
    from _typeshed import ReadableBuffer

INTERRUPTED = 130
NO_OUTPUT = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


def make_app() -> typer.Typer:
    """The application with all commands."""
    import typer

    from streamkit.cli.commands import SUMMARY, CommandGroup, version

    app = typer.Typer(
        name="streamkit", cls=CommandGroup, no_args_is_help=True,
        pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip
    app.callback(invoke_without_command=True, help=SUMMARY)(version)
    return app


class LossyOutput(io.FileIO):
    """A stream for people: what a closed terminal, an ended reader or a full disk refuses is lost."""

    def write(self, data: ReadableBuffer, /) -> int:
        """Writes what is taken."""
        try:
            return super().write(data) or 0
        except OSError:
            return memoryview(data).nbytes


def secure_streams() -> None:
    """Makes stdin, stdout and stderr usable, however the process was started, and stderr never fail.

    A file that is opened takes the lowest free descriptor: were 2 free, libraries would write into it.
    """
    for _ in range(3):
        if (free := os.open(os.devnull, os.O_RDWR)) > 2:
            os.close(free)
            break
    if sys.stdout is None:
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), write_through=True)
    if sys.stderr is sys.__stderr__:
        encoding = sys.stderr.encoding if sys.stderr is not None else "utf-8"
        raw = io.BufferedWriter(LossyOutput(2, "w", closefd=False))
        sys.stderr = io.TextIOWrapper(raw, encoding, "backslashreplace", line_buffering=True)


def main() -> None:
    """Entry point of the command line."""
    secure_streams()
    atexit.register(gc.freeze)  # no search for garbage in memory that the kernel takes back at once
    arguments = sys.argv[1:]
    try:
        make_app()(prog_name="streamkit")  # of `python -m streamkit`, too: it names the completion's script
    except (KeyboardInterrupt, SystemExit) as ended:
        # Ctrl-C before the command handles it itself; typer makes an exit of it.
        if isinstance(ended, SystemExit) and ended.code != INTERRUPTED:
            raise
        sys.exit(0 if arguments[:1] == ["launch"] else INTERRUPTED)
    except OSError as error:
        if error.errno not in NO_OUTPUT:
            raise
        sys.stderr.write(f"error: the output cannot be written: {error.strerror}\n")
        sys.exit(1)
