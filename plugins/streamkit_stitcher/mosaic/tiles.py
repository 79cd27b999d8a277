"""Square tiles of an unbounded image: the first in memory, later ones in temporary files."""

import os
import tempfile
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

ImageArray = npt.NDArray[np.uint8]
Key = tuple[int, int]

TILE: Final = 512


class TileStore:
    """Tiles uint8[512, 512, channels] by column and row, which are written in place.

    Args:
        channels: of a tile.
        max_px: most pixels in memory; each file holds as many.
    """

    def __init__(self, channels: int, max_px: int) -> None:
        self._shape = max(4, max_px // TILE**2), TILE, TILE, channels
        self._pages: list[ImageArray] = []
        self._numbers: dict[Key, int] = {}

    @property
    def keys(self) -> list[Key]:
        """Column and row of every tile, in the order made."""
        return list(self._numbers)

    def get(self, key: Key) -> ImageArray | None:
        """A tile, or None where there is none."""
        number = self._numbers.get(key)
        if number is None:
            return None
        page, place = divmod(number, self._shape[0])
        return np.asarray(self._pages[page][place])

    def make(self, key: Key) -> ImageArray:
        """A tile; a new one is black.

        Raises:
            OSError: there is no room for a temporary file.
        """
        tile = self.get(key)
        if tile is not None:
            return tile
        if len(self._numbers) == len(self._pages) * self._shape[0]:
            page = file_array(self._shape) if self._pages else np.zeros(self._shape, dtype=np.uint8)
            self._pages.append(page)
        number = self._numbers[key] = len(self._numbers)
        return np.asarray(self._pages[-1][number % self._shape[0]])

    def close(self) -> None:
        """Releases all tiles."""
        self._pages.clear()
        self._numbers.clear()


def file_array(shape: tuple[int, ...]) -> ImageArray:
    """A black uint8 array in a temporary file, which goes with the array.

    Raises:
        OSError: there is no room for the file.
    """
    with tempfile.TemporaryFile(prefix="streamkit-mosaic-") as file:
        # Without room now, a later write would end the process.
        os.posix_fallocate(file.fileno(), 0, int(np.prod(shape)))
        return np.memmap(file, dtype=np.uint8, mode="r+", shape=shape)


def tile_parts(
    left: int, top: int, width: int, height: int, side: int = TILE
) -> Iterator[tuple[Key, tuple[slice, slice], tuple[slice, slice]]]:
    """The tiles of a side under a box: key, the part of the tile, and the same part of the box."""
    for row in range(top // side, (top + height - 1) // side + 1):
        for column in range(left // side, (left + width - 1) // side + 1):
            x0, x1 = max(left, column * side), min(left + width, (column + 1) * side)
            y0, y1 = max(top, row * side), min(top + height, (row + 1) * side)
            there = slice(y0 - row * side, y1 - row * side), slice(x0 - column * side, x1 - column * side)
            yield (column, row), there, (slice(y0 - top, y1 - top), slice(x0 - left, x1 - left))
