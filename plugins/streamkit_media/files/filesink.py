"""filesink: the bytes of frames to a file."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, BinaryIO

from streamkit import Caps, Frame, Property, ResourceError, Sink, write_remedy
from streamkit_media.location import local_path

LINE_TYPES = ("text/", "application/json", "application/x-tracks", "application/x-json")


class FileSink(Sink):
    """Writes each frame's bytes to a file; text and JSON one frame a line.

    Example:
        videotestsrc num-buffers=5 ! filesink location=frames.raw
    """

    sink = "ANY"

    location: str = Property("", doc="Path of the file; an existing one is replaced.")

    def start(self) -> None:
        """Opens the file."""
        self._file: BinaryIO | None = None
        self._is_lines = False
        if not self.location:
            raise ResourceError("location= must name the file to write, it is empty; write location=out.bin")
        path = local_path(self.location)
        try:
            self._file = path.open("wb")
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ResourceError(
                f"{self.location}: cannot be written: {reason}; check that the directory exists and allows it"
            ) from None

    def configure(self, sink_caps: Caps) -> None:
        """Lines for text, bytes as they are for all else."""
        self._is_lines = sink_caps.name.startswith(LINE_TYPES)

    def render(self, frame: Frame) -> None:
        """Writes one frame.

        Raises:
            ResourceError: the disk refuses.
        """
        data = as_bytes(frame.data)
        try:
            assert self._file is not None
            self._file.write(data)
            if self._is_lines and bytes(data[-1:]) != b"\n":
                self._file.write(b"\n")
        except OSError as error:
            raise self._write_failure(error) from None

    def drain(self) -> None:
        """Flushes at EOS."""
        try:
            if self._file is not None:
                self._file.flush()
        except OSError as error:
            raise self._write_failure(error) from None

    def stop(self) -> None:
        """Closes the file."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def _write_failure(self, error: OSError) -> ResourceError:
        file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):  # the first error is reported
                file.close()
        return ResourceError(
            f"{self.location}: writing failed: {error.strerror or error}{write_remedy(error)}"
        )


def as_bytes(data: Any) -> bytes | memoryview:
    """The bytes of a frame's data: text in UTF-8, arrays row by row, anything else bytes-like as it is."""
    if isinstance(data, str):
        return data.encode()
    view = memoryview(data)
    return view.cast("B") if view.c_contiguous and view.nbytes else view.tobytes()
