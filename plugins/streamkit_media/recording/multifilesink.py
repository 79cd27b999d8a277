"""multifilesink and jpegsink: one file for each frame."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit import Frame, Property, ResourceError, Sink, write_remedy
from streamkit_media.files.filesink import as_bytes
from streamkit_media.location import SegmentNames, local_path


class MultiFileSink(Sink):
    """Writes each frame's bytes to a file of its own.

    Example:
        multifilesrc location=img/%06d.jpg ! multifilesink location=copy/%06d.jpg
    """

    sink = "ANY"

    location: str = Property("", doc="Path with a number: out/%06d.jpg.")
    max_files: int = Property(0, min=0, doc="Files kept; the oldest is deleted beyond it. 0 keeps all.")

    def start(self) -> None:
        """Checks the name and the directory."""
        self._names = SegmentNames(self.location, is_cut=False)
        self._written: deque[Path] = deque()
        if not self._names.has_number:
            raise ResourceError(
                f"location={self.location!r} must hold one number; write location=out/%06d.jpg"
            )
        folder = local_path(self.location).parent
        if not folder.is_dir():
            raise ResourceError(f"{self.location}: the directory {folder} must be there; make it first")

    def content(self, frame: Frame) -> bytes | memoryview:
        """What the frame's file holds."""
        return as_bytes(frame.data)

    def render(self, frame: Frame) -> None:
        """Writes one file.

        Raises:
            ResourceError: the disk refuses.
        """
        path = self._names.next_path()
        try:
            path.write_bytes(self.content(frame))
            self._written.append(path)
            if self.max_files and len(self._written) > self.max_files:
                self._written.popleft().unlink(missing_ok=True)
        except OSError as error:
            raise ResourceError(
                f"{path}: writing failed: {error.strerror or error}{write_remedy(error)}"
            ) from None
        if not self.max_files:
            self._written.clear()


class JpegSink(MultiFileSink):
    """Writes each frame to a JPEG file of its own.

    Example:
        videotestsrc num-buffers=3 ! jpegsink location=test-%03d.jpg
    """

    sink = "video/x-raw, format={ BGR, GRAY8 }"

    quality: int = Property(90, min=1, max=100, doc="Of the JPEG.")

    def content(self, frame: Frame) -> bytes | memoryview:
        """The frame as JPEG."""
        return jpeg_bytes(frame.data, self.quality)


def jpeg_bytes(pixels: NDArray[np.uint8], quality: int) -> bytes:
    """The JPEG of uint8[h, w] grey or uint8[h, w, 3] BGR pixels; quality from 1 to 100."""
    return cv2.imencode(".jpg", np.ascontiguousarray(pixels), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()
