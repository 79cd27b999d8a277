"""Crash report of `launch`: names the active elements if the process dies, as by a crash in native code."""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import mmap
import os
import subprocess
import tempfile
from collections.abc import Iterable

from streamkit.element.base import Element

CLOSE_LIMIT_S = 2.0
# Waits for a word on stdin; if the other end is closed without one, the process has died.
SCRIPT = r"""
read -r word && exit
names=$(sed -n 's/^1 //p' "$1" | tr '\n' ' ')
text="the process has died; elements at work: ${names:-none }"
if [ "$2" = json ]; then
    text=$(printf %s "$text" | sed 's/[\\"]/\\&/g')
    printf '{"time": "%s", "level": "error", "message": "%s"}\n' "$(date -u +%FT%TZ)" "$text" >&2
else
    echo "error: $text" >&2
fi
"""


class CrashReport:
    """Reports the elements that were at work when the process died.

    `faulthandler` prints the stack of each thread. Elements mark themselves in memory shared with a shell
    process (`Element.at_work`), which prints the names of those marked unless `close` was called before.
    """

    def __init__(self, elements: Iterable[Element], *, is_json: bool = False) -> None:
        with contextlib.suppress(ValueError, OSError, RuntimeError):  # stderr may be closed
            faulthandler.enable()
        members = list(elements)
        self._form = "json" if is_json else "text"
        lines = [f"0 {element.name} ({element.factory})\n".encode() for element in members]
        self._process: subprocess.Popen[bytes] | None = None
        with tempfile.TemporaryFile() as record:
            record.write(b"".join(lines) or b"\n")
            record.flush()
            marks = memoryview(mmap.mmap(record.fileno(), 0))
            offset = 0
            for element, line in zip(members, lines, strict=True):
                element.at_work = marks[offset : offset + 1]
                offset += len(line)
            with contextlib.suppress(OSError):  # no shell: only the traceback is printed
                self._process = self._watcher(record.fileno())
        atexit.register(self.close)  # Ctrl-C may come before or after the signals are handled

    def _watcher(self, record: int) -> subprocess.Popen[bytes]:
        inherited = os.dup(record)
        try:
            return subprocess.Popen(
                ["sh", "-c", SCRIPT, "sh", f"/dev/fd/{inherited}", self._form],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                pass_fds=(inherited,),
                start_new_session=True,  # ignores Ctrl-C in the terminal
            )
        finally:
            os.close(inherited)

    def close(self) -> None:
        """Ends the shell process without a report."""
        atexit.unregister(self.close)
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            process.communicate(b"ends\n", timeout=CLOSE_LIMIT_S)
