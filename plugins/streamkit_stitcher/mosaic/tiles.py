"""Square tiles of an unbounded image: the latest in memory, the others in a temporary file."""

import tempfile
from collections import OrderedDict
from dataclasses import dataclass
from typing import IO, Final

import cv2
import numpy as np
import numpy.typing as npt

ImageArray = npt.NDArray[np.uint8]

TILE: Final = 512
REDUCTION: Final = 4


@dataclass(frozen=True, eq=False)
class Tile:
    """One tile.

    Attributes:
        pixels: uint8[512, 512, c].
        depth: uint8[512, 512], depth of each pixel inside its frame, 0 where not painted.
    """

    pixels: ImageArray
    depth: ImageArray


class TileStore:
    """Tiles by column and row.

    Args:
        channels: of the pixels.
        max_px: most pixels in memory; the least recently used tiles go to the file.
    """

    def __init__(self, channels: int, max_px: int) -> None:
        self.channels = channels
        self._most = max(4, max_px // TILE**2)
        self._tiles: OrderedDict[tuple[int, int], Tile] = OrderedDict()
        self._slots: dict[tuple[int, int], int] = {}
        self._painted: set[tuple[int, int]] = set()
        self._small: dict[tuple[int, int], ImageArray] = {}
        self._file: IO[bytes] | None = None

    @property
    def keys(self) -> tuple[tuple[int, int], ...]:
        """Column and row of every tile, sorted."""
        return tuple(sorted(self._painted))

    def reduced(self, key: tuple[int, int]) -> ImageArray | None:
        """uint8[128, 128, c], a cached tile at a quarter of its sides; None where not painted."""
        found = self._small.get(key)
        if found is None:
            tile = self.get(key)
            if tile is None:
                return None
            side = TILE // REDUCTION
            small = cv2.resize(tile.pixels, (side, side), interpolation=cv2.INTER_AREA)
            found = self._small[key] = np.asarray(small, dtype=np.uint8).reshape(side, side, -1)
        return found

    def get(self, key: tuple[int, int]) -> Tile | None:
        """A tile, or None where not painted."""
        tile = self._tiles.get(key)
        if tile is not None:
            self._tiles.move_to_end(key)
            return tile
        if key not in self._slots or self._file is None:
            return None
        size = TILE * TILE * (self.channels + 1)
        self._file.seek(self._slots[key] * size)
        data = np.frombuffer(self._file.read(size), dtype=np.uint8).reshape(TILE, TILE, self.channels + 1)
        tile = Tile(np.ascontiguousarray(data[:, :, :-1]), np.ascontiguousarray(data[:, :, -1]))
        self._keep(key, tile)
        return tile

    def put(self, key: tuple[int, int], tile: Tile) -> None:
        """Stores a tile.

        Raises:
            OSError: the temporary file is full.
        """
        self._small.pop(key, None)
        self._painted.add(key)
        self._keep(key, tile)

    def close(self) -> None:
        """Releases all tiles and the file."""
        self._tiles.clear()
        self._slots.clear()
        self._painted.clear()
        self._small.clear()
        if self._file is not None:
            self._file.close()
            self._file = None

    def _keep(self, key: tuple[int, int], tile: Tile) -> None:
        self._tiles[key] = tile
        self._tiles.move_to_end(key)
        while len(self._tiles) > self._most:
            self._spill(*self._tiles.popitem(last=False))

    def _spill(self, key: tuple[int, int], tile: Tile) -> None:
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="streamkit-mosaic-")  # noqa: SIM115  closed by close()
        slot = self._slots.setdefault(key, len(self._slots))
        self._file.seek(slot * TILE * TILE * (self.channels + 1))
        self._file.write(np.concatenate([tile.pixels, tile.depth[:, :, np.newaxis]], axis=2).tobytes())
