"""Which ground the pictures of a plane show, without the pictures."""

from typing import Final

import numpy as np

from streamkit_stitcher.homographies import FloatArray, to_reduced
from streamkit_stitcher.mosaic.mosaic import Mosaic

_FACTOR: Final = 4
_LEAST_SIDE: Final = 64


class Coverage:
    """The outlines of pictures on a plane, on a grid of 4 px: a sixteenth of a mosaic's work.

    Args:
        max_px: most px of the plane that are kept in memory.
    """

    def __init__(self, max_px: int) -> None:
        self._outlines = Mosaic(max_px // _FACTOR**2, _FACTOR)

    @property
    def is_empty(self) -> bool:
        """Whether no picture was added."""
        return self._outlines.canvas.is_empty

    @property
    def covered_px(self) -> float:
        """Covered area, in px of the plane."""
        return self._outlines.covered_px * _FACTOR**2

    def add(self, shape: tuple[int, int], to_plane: FloatArray) -> bool:
        """Adds a picture's outline.

        Args:
            shape: (height, width) of the picture, px.
            to_plane: float64[3, 3], its pixels to the plane.

        Returns:
            False where a mosaic would not take the picture, either: see `Mosaic.add`.

        Raises:
            OSError: a temporary file takes no more.
        """
        height, width = _reduced(shape)
        return self._outlines.add(np.full((height, width), 255, dtype=np.uint8), _on_grid(shape, to_plane))

    def uncovered(self, shape: tuple[int, int], to_plane: FloatArray) -> float:
        """Part of a picture that shows ground of no picture added so far, 0 to 1."""
        return self._outlines.uncovered(_reduced(shape), _on_grid(shape, to_plane))

    def move_plane(self, change: FloatArray) -> None:
        """Follows a change of the plane, float64[3, 3] old to new."""
        self._outlines.canvas.move_plane(to_reduced(change, _FACTOR))

    def close(self) -> None:
        """Lets go of everything."""
        self._outlines.canvas.close()


def _reduced(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns that stand for a picture: fewer, but never too few for an outline."""
    height, width = (max(min(_LEAST_SIDE, side), side // _FACTOR) for side in shape)
    return height, width


def _on_grid(shape: tuple[int, int], to_plane: FloatArray) -> FloatArray:
    """float64[3, 3] from those rows and columns to the grid."""
    height, width = _reduced(shape)
    across, down = shape[1] / width, shape[0] / height
    enlarged = np.array([[across, 0, (across - 1) / 2], [0, down, (down - 1) / 2], [0, 0, 1]])
    shrunk = np.array([[1, 0, (1 - _FACTOR) / 2], [0, 1, (1 - _FACTOR) / 2], [0, 0, _FACTOR]])
    return np.asarray(shrunk @ to_plane @ enlarged, dtype=np.float64)
