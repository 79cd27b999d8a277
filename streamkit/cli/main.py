"""The command `streamkit`: imports only the requested command, for a fast start.

This module has no slow imports, so that Ctrl-C is handled from the beginning.
"""

from __future__ import annotations

import errno
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import typer

INTERRUPTED = 130
NO_OUTPUT = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


def make_app(arguments: Sequence[str]) -> typer.Typer:
    """The application with the command named first in the arguments, or with all commands."""
    from streamkit.cli.commands import application

    return application(arguments)


def main() -> None:
    """Entry point of the command line."""
    arguments = sys.argv[1:]
    try:
        make_app(arguments)()
    except KeyboardInterrupt:  # before the command handles it itself
        sys.exit(0 if arguments[:1] == ["launch"] else INTERRUPTED)
    except OSError as error:
        if error.errno not in NO_OUTPUT:
            raise
        sys.stderr.write(f"error: the output cannot be written: {error.strerror}\n")
        sys.exit(1)
