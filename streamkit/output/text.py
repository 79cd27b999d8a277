"""TextFormat: base of text formats that are written piece by piece."""

from __future__ import annotations

from typing import ClassVar


class TextFormat:
    """The bytes before the first piece and after the last one.

    Attributes:
        has_end: whether the file is not whole without `end`, as JSON in brackets.
    """

    has_end: ClassVar[bool] = False

    def begin(self) -> bytes:
        """The start of the file."""
        return b""

    def end(self) -> bytes:
        """The end of the file, after what was written so far; called each time others may read it."""
        return b""
