"""TextFormat: base of text formats that are written incrementally."""

from __future__ import annotations

from typing import ClassVar


class TextFormat:
    """Beginning and end of a text file.

    Attributes:
        has_end: whether the file is incomplete without `end`, for example JSON without its closing bracket.
    """

    has_end: ClassVar[bool] = False

    def begin(self) -> bytes:
        """The start of the file."""
        return b""

    def end(self) -> bytes:
        """The end of the file after what is written so far; called at each write."""
        return b""
