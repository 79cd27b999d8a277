"""Frames stored for the final mosaic: uncompressed in memory, then as JPEG in a temporary file."""

import tempfile
from typing import IO, Final

import cv2
import numpy as np

from streamkit_stitcher.mosaic.tiles import ImageArray

# As many as homographies of keyframes are kept.
MAX_FRAMES: Final = 20_000
_JPEG_QUALITY: Final = 95


class FrameStore:
    """Frames by number.

    Args:
        memory_bytes: most bytes in memory, lossless; the rest goes to a temporary file.
        file_bytes: most bytes of that file; frames beyond it are refused.
    """

    def __init__(self, memory_bytes: int = 256_000_000, file_bytes: int = 8_000_000_000) -> None:
        self._memory, self._max_bytes = memory_bytes, file_bytes
        self._kept: list[ImageArray | tuple[int, int]] = []  # the frame, or its offset and size in the file
        self._in_memory = self._written = 0
        self._file: IO[bytes] | None = None
        self._last: tuple[int, ImageArray] | None = None

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, frame: ImageArray) -> int | None:
        """Stores uint8[h, w] or uint8[h, w, 3]; returns its number, or None when full.

        Raises:
            OSError: the temporary file cannot be written.
        """
        if len(self._kept) >= MAX_FRAMES:
            return None
        if self._in_memory + frame.nbytes <= self._memory:
            # A copy: the buffer behind the frame may be reused.
            self._kept.append(frame.copy())
            self._in_memory += frame.nbytes
            return len(self._kept) - 1
        done, encoded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        if not done or self._written + len(encoded) > self._max_bytes:
            return None
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="streamkit-frames-")  # noqa: SIM115  see close()
        self._file.seek(self._written)
        self._file.write(encoded.tobytes())
        self._kept.append((self._written, len(encoded)))
        self._written += len(encoded)
        return len(self._kept) - 1

    def get(self, number: int) -> ImageArray:
        """The frame of that number.

        Raises:
            OSError: it cannot be read back.
        """
        kept = self._kept[number]
        if not isinstance(kept, tuple):
            return kept
        if self._last is not None and self._last[0] == number:
            return self._last[1]
        decoded = None
        if self._file is not None:
            self._file.seek(kept[0])
            data = np.frombuffer(self._file.read(kept[1]), dtype=np.uint8)
            decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        if decoded is None:
            raise OSError("a frame of the mosaic could not be read back from the temporary file")
        frame = np.asarray(decoded, dtype=np.uint8)
        self._last = number, frame
        return frame

    def close(self) -> None:
        """Releases all frames."""
        self._kept.clear()
        self._last = None
        if self._file is not None:
            self._file.close()
            self._file = None
