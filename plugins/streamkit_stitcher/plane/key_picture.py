"""What is kept of a key picture, worked out beside the stream."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.patches import cut_patches, pyramid

LEVELS: Final = 4
_GRID: Final = (25, 16)
_TIMEOUT_S: Final = 20.0
_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class KeyPicture:
    """A key picture kept as patches around its corners rather than as pixels.

    Attributes:
        points: float64[n, 2], patch centres, full-size px.
        patches: one uint8[n, 17, 17] per pyramid level, finest first.
        small: uint8[h, w], the picture at working size, to recognise it by.
    """

    points: FloatArray
    patches: tuple[GreyArray, ...]
    small: GreyArray


def key_picture(images: Sequence[GreyArray], level: int) -> KeyPicture:
    """The patches around the best corners of an even grid.

    Args:
        images: the picture and its halvings.
        level: which of them is at working size; corners are looked for there.
    """
    factor = 2**level
    points = even_corners(images[level], *_GRID) * factor + (factor - 1) / 2
    return patches_around(points, pyramid(images, max(LEVELS, level + 1)), level)


def patches_around(points: FloatArray, images: Sequence[GreyArray], level: int) -> KeyPicture:
    """The patches around points float64[n, 2], full-size px, of a picture and its halvings."""
    rounded = np.rint(points)
    patches = tuple(
        cut_patches(image, at_level(rounded, number)) for number, image in enumerate(images[:LEVELS])
    )
    return KeyPicture(rounded, patches, images[level].copy())


def at_level(points: FloatArray, level: int) -> FloatArray:
    """The pixel of a pyramid level nearest to each of some full-size points, float64[n, 2].

    Whole pixels: patches cut between them would be smoother than the pictures they are compared with.
    """
    factor = 2**level
    return np.asarray(np.rint((points - (factor - 1) / 2) / factor), dtype=np.float64)


class Beside:
    """One worker for what a picture needs only when the next one comes.

    Whoever needs a result waits for it, so that the same pictures give the same places however the threads
    run.
    """

    def __init__(self) -> None:
        self._executor: ThreadPoolExecutor | None = None

    def begin(self, work: Callable[..., _Result], *arguments: Any) -> Callable[[], _Result]:
        """Begins some work, after what was begun before; returns what waits for its result, at most 20 s."""
        if self._executor is None:
            self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="keyframes")
        return partial(self._executor.submit(work, *arguments).result, _TIMEOUT_S)

    def close(self) -> None:
        """Ends the worker after all that was begun."""
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.shutdown(wait=True)
