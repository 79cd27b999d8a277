"""Bases of the sinks that write files: one, several with a number or time, or text in one of some formats."""

from __future__ import annotations

import contextlib
import enum
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from streamkit.element.older_files import IfExists, file_place, next_number
from streamkit.element.property import Property
from streamkit.element.property_owner import SettingsOf
from streamkit.element.sink import Sink
from streamkit.errors import PropertyError, ResourceError, StreamkitError, write_remedy
from streamkit.flow.frame import Frame
from streamkit.output.file import OutputFile, check_writable, is_special
from streamkit.output.names import FileNames, local_path
from streamkit.output.pipe import STANDARD_OUTPUT, ReaderWait, standard_output
from streamkit.output.retention import Retention, RetentionLimits
from streamkit.output.text import TextFormat

CLOSE_LIMIT_S = 5.0
AnyFormat = TypeVar("AnyFormat", bound=TextFormat)
AUTO = "auto"


class OutputFileSink(Sink):
    """Base class of sinks that write files: override `write`, and `begin` and `end` if the format needs it.

    A file is made with the first frame, and replaces an older one when it is whole; see `OutputFile`. A run
    without a frame leaves the older one as it is, and says so. Each error is raised once, as `ResourceError`.

    Attributes:
        suffixes: endings of the name that are known; any where empty.
        example: a location, for errors.
        write_errors: exceptions by which writing fails.
        has_begun: whether a frame was given to `write`.
        number: of the next file, where several are written.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[str] = "out.bin"
    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError,)

    location: str = Property(
        "", file="write", doc="File to write; missing folders are made. - is the standard output."
    )
    if_exists: IfExists = Property(
        IfExists.REPLACE,
        doc="An older file: refuse it, continue it or its numbers, or replace it when whole.",
    )
    timeout_s: float = Property(
        10.0, min=0.1, max=3600.0, unit="s", doc="How long what reads a pipe may take nothing."
    )

    file: OutputFile | None = None
    _written_before: tuple[str, ...] = ()

    # Overridden by authors.

    def begin(self) -> None:
        """Prepares for the first frame; opens `file`."""
        self.file = self.open_file()

    def write(self, frame: Frame) -> None:
        """Writes one frame."""
        raise NotImplementedError

    def end(self) -> None:
        """Completes the file, at EOS or a stop; only after `begin`."""
        if self.file is not None:
            self.file.finish()

    def abandon(self) -> None:
        """Closes the file after an error; never fails."""
        if self.file is not None:
            self.file.abandon()

    def shortfall(self) -> str:
        """Why nothing of use is written though frames came, such as no tracks, or ""."""
        return ""

    def remark(self) -> str:
        """What the complete file contains less of than its user may expect, though nothing failed, or ""."""
        return ""

    def has_content(self) -> bool:
        """Whether the file that is open holds more than a start and an end; else an older one is left."""
        return True

    def can_append(self) -> bool:
        """Whether `if-exists=continue` may append to a file."""
        return False

    def needs_several_files(self) -> bool:
        """Whether one file cannot hold the stream; a number is then added to the name."""
        return False

    def is_file(self) -> bool:
        """Whether files are written, or a device or pipe that has a path."""
        return True

    def pattern(self) -> str:
        """What names the files."""
        return self.location

    # Called by authors.

    def open_file(self, *, is_whole: bool = False) -> OutputFile:
        """The next file; with `is_whole` it appears once it has content that is complete."""
        append = self.can_append() and self.if_exists is IfExists.CONTINUE
        reader_wait = ReaderWait(self.timeout_s, self.stopping, self.waiting)
        return OutputFile(self.next_path(), append=append, is_whole=is_whole, reader_wait=reader_wait)

    def next_path(self) -> Path:
        """The path of the next file.

        Raises:
            ResourceError: it exists, and `if-exists` protects it.
        """
        path = file_place(self, self.names.path(self.number, self.clock.utc_ns()))
        self.number += 1
        self.results["files"] += 1
        self._written_before, self.written_paths = self.written_paths, (*self.written_paths[:1], str(path))
        return path

    def take_back(self) -> None:
        """Gives the number of the last file, which was not written, to the next one."""
        self.number -= 1
        self.results["files"] -= 1
        self.written_paths = self._written_before

    # Called by the engine.

    def check_properties(self) -> None:
        """Checks the ending of the name."""
        path = local_path(self.location)
        if not self.location or not self.suffixes or is_special(path):
            return
        if path.suffix.lower() not in self.suffixes:
            raise PropertyError(
                f"{self.name}: location={self.location}: the name must end in {', '.join(self.suffixes)}, "
                f"it ends in {path.suffix!r}; write for example location={self.example}"
            )

    def start(self) -> None:
        """Checks the name and the folder; nothing is written before the first frame."""
        self._writing = threading.Lock()
        self.file = None
        self._written_before = ()
        self.has_begun = self._is_over = False
        self.number = 0
        if not self.location:
            raise ResourceError(f"location must be set; write for example location={self.example}")
        if self.location == STANDARD_OUTPUT:
            standard_output()
        self.check_properties()
        self.names = FileNames(self.pattern(), adds_number=self.needs_several_files())
        if not self.is_file():
            return
        with self.reported():
            first = self.names.path(0, self.clock.utc_ns())
            check_writable(first)
            if self.names.is_several:
                self.number = next_number(self)
            else:
                file_place(self, first)

    def render(self, frame: Frame) -> None:
        """Writes one frame.

        Raises:
            ResourceError: the disk refuses.
        """
        with self._writing, self.reported():
            if not self.has_begun:
                self.has_begun = True
                self.begin()
            self.write(frame)

    def drain(self) -> None:
        """EOS: the file is completed."""
        self._warn_of_no_frame()
        self._complete()

    def stop(self) -> None:
        """Completes the file where EOS did not."""
        if self.is_playing and self.timing.running.is_set():  # else no frame could have come
            self._warn_of_no_frame()
        self._complete()

    def _warn_of_no_frame(self) -> None:
        if self.has_begun or self._is_over:
            return
        self._is_over = True
        if self.pipeline_error() is None:  # EOS follows a failure, which says enough
            self.post_warning(f"{self.location}: no frame came, nothing is written", "shortfall")

    def _complete(self) -> None:
        # Libraries that two threads use hang: a file whose writer is still at work cannot be completed.
        if not self._writing.acquire(timeout=CLOSE_LIMIT_S):
            raise ResourceError(
                f"{self.location}: writing took more than {CLOSE_LIMIT_S:g} s, the file is incomplete"
            )
        try:
            is_open, self._is_over = self.has_begun and not self._is_over, True
            if is_open:
                with self.reported():
                    if self.file is not None and self.file.hides_older and not self.has_content():
                        self.take_back()
                        self.file.discard()
                    else:
                        self.end()
                if text := self.shortfall():
                    self.post_warning(f"{self.location}: {text}", "shortfall")
                elif text := self.remark():
                    self.post_message("note", text=f"{self.location}: {text}")
        finally:
            self._writing.release()

    @contextlib.contextmanager
    def reported(self) -> Iterator[None]:
        """Turns an error of writing into ResourceError, once, and abandons the file."""
        try:
            yield
        except StreamkitError:
            raise
        except self.write_errors as error:
            self._is_over = True
            self.abandon()
            if self.written_paths and not Path(self.written_paths[-1]).exists():
                self.take_back()
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise ResourceError(
                f"location={self.location}: cannot be written: {reason}{write_remedy(error)}"
            ) from error


class NumberedFilesSink(OutputFileSink):
    """Base class of sinks that write many files and may delete the oldest.

    Attributes:
        remembers_earlier_runs: whether files of earlier runs count, too.
    """

    remembers_earlier_runs: ClassVar[bool] = True

    if_exists: IfExists = Property(
        IfExists.CONTINUE,
        doc="Older files: refuse them, continue their numbers (one file: refuse it), or replace them.",
    )
    retention_limits = SettingsOf(RetentionLimits)

    def start(self) -> None:
        """Checks the name, and reads which files of earlier runs may be deleted."""
        super().start()
        pattern = local_path(self.location)
        ledger = pattern.with_name(f".{pattern.name}.written") if self.remembers_earlier_runs else None
        self._retention = Retention(self.retention_limits, pattern.parent, ledger)

    def file_is_complete(self, path: Path, companion: Path | None = None) -> None:
        """Adds a complete file and its companion to those kept; deletes the oldest beyond the limits."""
        if deleted := self._retention.add(path, self.clock.utc_ns() / 1e9, companion):
            self.results["deleted_files"] += deleted


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
