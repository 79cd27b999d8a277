"""Colour for people: the first word of a line says what it is."""

from __future__ import annotations

import os

BOLD, RED, GREEN, YELLOW = 1, 31, 32, 33
CODES = {
    "error:": RED, "bad": RED, "warning:": YELLOW, "note:": YELLOW, "note": YELLOW,
    "good": GREEN, "Pads": BOLD, "Properties": BOLD, "Example": BOLD,
}  # fmt: skip


def coloured(text: str) -> str:
    """The first words of lines, and carets, in colour, unless NO_COLOR is set (https://no-color.org).

    `typer.echo` leaves the colours out where it does not print on a terminal.
    """
    return text if os.environ.get("NO_COLOR") else "\n".join(map(_line, text.split("\n")))


def _line(line: str) -> str:
    word = line.split(" ", 1)[0] or line.strip()
    code = RED if word and not word.strip("^") else CODES.get(word)
    return line if code is None else line.replace(word, f"\x1b[{code}m{word}\x1b[0m", 1)
