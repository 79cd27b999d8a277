"""Pictures kept for the final mosaic: packed without loss, in memory first, then in a temporary file."""

import tempfile
from dataclasses import dataclass
from typing import IO, Final

import cv2
import numpy as np

from streamkit_stitcher.mosaic.tiles import PictureArray

_THUMBNAIL_WIDTH: Final = 96


@dataclass(frozen=True)
class _Packed:
    data: bytes
    offset: int
    size: int


class PictureStore:
    """Pictures by the order in which they came.

    Args:
        memory_bytes: most bytes kept in memory; the rest goes to a temporary file.
        file_bytes: most bytes of that file; pictures beyond it are refused.
    """

    def __init__(self, memory_bytes: int = 96_000_000, file_bytes: int = 8_000_000_000) -> None:
        self._memory, self._most = memory_bytes, file_bytes
        self._packed: list[_Packed] = []
        self._in_memory = 0
        self._written = 0
        self._file: IO[bytes] | None = None
        self._last: tuple[int, PictureArray] | None = None

    def __len__(self) -> int:
        return len(self._packed)

    def add(self, picture: PictureArray) -> int | None:
        """Keeps uint8[h, w] or uint8[h, w, 3]; returns its number, or None where there is no more room.

        Raises:
            OSError: the temporary file takes no more.
        """
        done, encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            return None
        data = encoded.tobytes()
        if self._in_memory + len(data) <= self._memory:
            self._packed.append(_Packed(data, 0, len(data)))
            self._in_memory += len(data)
        elif self._written + len(data) <= self._most:
            if self._file is None:
                self._file = tempfile.TemporaryFile(prefix="streamkit-pictures-")  # noqa: SIM115  see close()
            self._file.seek(self._written)
            self._file.write(data)
            self._packed.append(_Packed(b"", self._written, len(data)))
            self._written += len(data)
        else:
            return None
        return len(self._packed) - 1

    def get(self, number: int) -> PictureArray:
        """The picture of that number."""
        if self._last is not None and self._last[0] == number:
            return self._last[1]
        packed = self._packed[number]
        data = packed.data
        if not data and self._file is not None:
            self._file.seek(packed.offset)
            data = self._file.read(packed.size)
        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        if decoded is None:
            raise OSError("a picture of the mosaic could not be read back from the temporary file")
        picture = np.asarray(decoded, dtype=np.uint8)
        self._last = number, picture
        return picture

    def close(self) -> None:
        """Lets go of everything."""
        self._packed.clear()
        self._last = None
        if self._file is not None:
            self._file.close()
            self._file = None


def thumbnail_factor(width: int) -> int:
    """How often to halve a picture of `width` px for the planning of seams and exposures."""
    level = 0
    while width >> (level + 1) >= _THUMBNAIL_WIDTH:
        level += 1
    return int(2**level)
