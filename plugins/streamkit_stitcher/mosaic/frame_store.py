"""Frames kept for the final mosaic: as they are in memory, then as JPEG in a temporary file."""

import tempfile
from dataclasses import dataclass
from typing import IO, Final

import cv2
import numpy as np

from streamkit_stitcher.mosaic.tiles import ImageArray

_THUMBNAIL_WIDTH: Final = 96
_JPEG_QUALITY: Final = 95


@dataclass(frozen=True)
class _Slot:
    offset: int
    size: int


class FrameStore:
    """Frames by the order in which they came.

    Args:
        memory_bytes: most bytes kept in memory, without loss; the rest goes to a temporary file.
        file_bytes: most bytes of that file; frames beyond it are refused.
    """

    def __init__(self, memory_bytes: int = 256_000_000, file_bytes: int = 8_000_000_000) -> None:
        self._memory, self._most = memory_bytes, file_bytes
        self._kept: list[ImageArray | _Slot] = []
        self._in_memory = 0
        self._written = 0
        self._file: IO[bytes] | None = None
        self._last: tuple[int, ImageArray] | None = None

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, frame: ImageArray) -> int | None:
        """Keeps uint8[h, w] or uint8[h, w, 3]; returns its number, or None where there is no more room.

        Raises:
            OSError: the temporary file takes no more.
        """
        if self._in_memory + frame.nbytes <= self._memory:
            # A copy: the frame may be a view of a frame that somebody else reuses.
            self._kept.append(frame.copy())
            self._in_memory += frame.nbytes
            return len(self._kept) - 1
        done, encoded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        if not done or self._written + len(encoded) > self._most:
            return None
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="streamkit-frames-")  # noqa: SIM115  see close()
        self._file.seek(self._written)
        self._file.write(encoded.tobytes())
        self._kept.append(_Slot(self._written, len(encoded)))
        self._written += len(encoded)
        return len(self._kept) - 1

    def get(self, number: int) -> ImageArray:
        """The frame of that number.

        Raises:
            OSError: it could not be read back.
        """
        kept = self._kept[number]
        if not isinstance(kept, _Slot):
            return kept
        if self._last is not None and self._last[0] == number:
            return self._last[1]
        decoded = None
        if self._file is not None:
            self._file.seek(kept.offset)
            data = np.frombuffer(self._file.read(kept.size), dtype=np.uint8)
            decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        if decoded is None:
            raise OSError("a frame of the mosaic could not be read back from the temporary file")
        frame = np.asarray(decoded, dtype=np.uint8)
        self._last = number, frame
        return frame

    def close(self) -> None:
        """Lets go of everything."""
        self._kept.clear()
        self._last = None
        if self._file is not None:
            self._file.close()
            self._file = None


def thumbnail_factor(width: int) -> int:
    """How often to halve a frame of `width` px for the planning of seams and exposures."""
    level = 0
    while width >> (level + 1) >= _THUMBNAIL_WIDTH:
        level += 1
    return int(2**level)
