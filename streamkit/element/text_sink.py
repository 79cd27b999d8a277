"""TextFileSink: base of the sinks that write text in one of several formats."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from streamkit.element.output_sink import OutputFileSink
from streamkit.output.text import TextFormat

AnyFormat = TypeVar("AnyFormat", bound=TextFormat)
AUTO = "auto"


class TextFileSink(OutputFileSink, Generic[AnyFormat]):
    """Base class of sinks with a property `format`: override `write`, which calls `append`.

    Lines are with the operating system at once; other formats are whole once a second. A file of such
    a format that has a start and an end only does not replace an older one.

    Attributes:
        formats: the formats by the values of `format`.
        kinds: the values by the ending of the name, for `format=auto`; the first is that of other names.
    """

    formats: ClassVar[Mapping[str, type[TextFormat]]] = {}
    kinds: ClassVar[Mapping[str, enum.StrEnum]] = {}
    format: enum.StrEnum

    def kind(self) -> str:
        """The format to write."""
        if self.format != AUTO:
            return self.format
        return self.kinds.get(Path(self.location).suffix.lower(), next(iter(self.kinds.values())))

    def check_properties(self) -> None:
        """Checks the ending of the name, unless the format is given."""
        if self.format == AUTO:
            super().check_properties()

    def make_content(self) -> AnyFormat:
        """The format of a new file."""
        return self.formats[self.kind()]()  # type: ignore[return-value]  # one of `formats`

    def can_append(self) -> bool:
        """Whether the format is lines."""
        return not self.formats[self.kind()].has_end

    def begin(self) -> None:
        """Opens the file, and writes its start."""
        self.content = self.make_content()
        self.file = self.open_file(is_whole=self.content.has_end)
        self._start = self.content.begin() if self.file.is_new else b""
        self.append(b"")

    def append(self, data: bytes) -> None:
        """Writes the next piece."""
        assert self.file is not None, "begin() precedes pieces"
        has_end = self.content.has_end
        if has_end and not data and self.file.hides_older:
            return
        self.file.append(self._start + data, self.content.end if has_end else None)
        self._start = b""

    def has_content(self) -> bool:
        """Whether a piece was written; the start of lines counts."""
        return not self._start
