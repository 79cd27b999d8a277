"""Planes that are used again for every frame: a fresh half megabyte costs more than what is done with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]


MOST_VIEWS = 200


@dataclass(slots=True)
class Scratch:
    """Byte planes by name. Asking for a name again gives the same memory: what was in it is then gone.

    One thread at a time may use it.
    """

    _planes: dict[str, ByteImage] = field(default_factory=dict)
    _views: dict[tuple[str, tuple[int, ...]], ByteImage] = field(default_factory=dict)

    def plane(self, name: str, shape: tuple[int, ...]) -> ByteImage:
        """uint8[h, w] with anything in it, contiguous whatever shapes were asked for before."""
        view = self._views.get((name, shape))
        if view is not None:
            return view
        size = shape[0] * shape[1]
        flat = self._planes.get(name)
        if flat is None or flat.size < size:
            # Regions grow and shrink by some pixels from frame to frame.
            flat = self._planes[name] = np.empty(size + size // 4, np.uint8)
            self._views.clear()
        if len(self._views) >= MOST_VIEWS:
            self._views.clear()
        view = self._views[name, shape] = flat[:size].reshape(shape[0], shape[1])
        return view
