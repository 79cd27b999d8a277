"""multifilesink and jpegsink: one file for each frame."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit import Caps, Frame, NumberedFilesSink, Property, ResourceError
from streamkit.output.file import OutputFile
from streamkit_media.files.filesink import as_bytes, check_pixels


class MultiFileSink(NumberedFilesSink):
    """Writes each frame's bytes to a file of its own.

    Example:
        multifilesrc location=img/%06d.jpg ! multifilesink location=copy/%06d.jpg
    """

    sink = "ANY"
    example = "out/%06d.jpg"
    remembers_earlier_runs = False  # it would be written with each frame

    location: str = Property("", file="write", doc="Path with a number or time: out/%06d.jpg.")

    def start(self) -> None:
        """Checks that there is a name for each frame."""
        super().start()
        if not self.names.is_several:
            raise ResourceError(
                f"location={self.location!r} must hold one number; write location={self.example}"
            )

    def configure(self, sink_caps: Caps) -> None:
        """Checks that files named as images are images.

        Raises:
            ResourceError: they would hold raw pixels.
        """
        check_pixels(sink_caps, self.location, "multifilesink")

    def begin(self) -> None:
        """Nothing is common to all files."""

    def content(self, frame: Frame) -> bytes | memoryview:
        """What the frame's file holds."""
        return as_bytes(frame.data)

    def write(self, frame: Frame) -> None:
        """Writes one file."""
        self.file = OutputFile(self.next_path(), is_whole=True)
        self.file.write(self.content(frame))
        self.file.finish()
        self.file_is_complete(self.file.path)


class JpegSink(MultiFileSink):
    """Writes each frame to a JPEG file of its own.

    Example:
        videotestsrc num-buffers=3 ! jpegsink location=test-%03d.jpg
    """

    sink = "video/x-raw, format={ BGR, GRAY8 }"
    suffixes = (".jpg", ".jpeg")

    quality: int = Property(90, min=1, max=100, doc="Of the JPEG.")

    def configure(self, sink_caps: Caps) -> None:
        """Files are images."""

    def content(self, frame: Frame) -> bytes | memoryview:
        """The frame as JPEG."""
        return jpeg_bytes(frame.data, self.quality)


def jpeg_bytes(pixels: NDArray[np.uint8], quality: int) -> bytes:
    """The JPEG of uint8[h, w] grey or uint8[h, w, 3] BGR pixels; quality from 1 to 100."""
    return cv2.imencode(".jpg", np.ascontiguousarray(pixels), [cv2.IMWRITE_JPEG_QUALITY, quality])[
        1
    ].tobytes()
