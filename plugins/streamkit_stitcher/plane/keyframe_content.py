"""What is kept of a keyframe's pixels, computed in the background."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.patches import cut_patches, pyramid

LEVELS: Final = 4
TIMEOUT_S: Final = 20.0
_SCENE_WIDTH: Final = 1000
_GRID: Final = (25, 16)
_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class KeyframeContent:
    """Patches around the corners of a keyframe.

    Attributes:
        points: float64[n, 2], patch centres, full-size px.
        patches: one uint8[n, 17, 17] per pyramid level, finest first.
        small: uint8[h, w], the frame at working size.
        scene: uint8[h, w], the frame at the size for feature matching.
    """

    points: FloatArray
    patches: tuple[GreyArray, ...]
    small: GreyArray
    scene: GreyArray


def keyframe_content(images: Sequence[GreyArray], level: int) -> KeyframeContent:
    """Cuts patches around the best corners of an even grid of the image `level`, at working size."""
    factor = 2**level
    points = even_corners(images[level], *_GRID) * factor + (factor - 1) / 2
    return patches_around(points, pyramid(images, max(LEVELS, level + 1)), level)


def patches_around(points: FloatArray, images: Sequence[GreyArray], level: int) -> KeyframeContent:
    """Cuts patches around points float64[n, 2], full-size px, of a frame and its halvings."""
    rounded = np.rint(points)
    patches = tuple(
        cut_patches(image, at_level(rounded, number)) for number, image in enumerate(images[:LEVELS])
    )
    small, scene = images[level].copy(), scene_level(images[0].shape)
    return KeyframeContent(rounded, patches, small, small if scene == level else images[scene].copy())


def scene_level(shape: Sequence[int]) -> int:
    """How often a frame of (height, width) is halved for feature matching."""
    level = 0
    while shape[1] >> level > _SCENE_WIDTH:
        level += 1
    return level


def at_level(points: FloatArray, level: int) -> FloatArray:
    """The pixel of a pyramid level nearest to each full-size point, float64[n, 2].

    Whole pixels: interpolated patches would be smoother than the frames they are compared with.
    """
    factor = 2**level
    return np.asarray(np.rint((points - (factor - 1) / 2) / factor), dtype=np.float64)


def executor_for(name: str) -> BackgroundExecutor:
    """A thread for work whose results are always asked for, so that no failure goes unseen."""
    return BackgroundExecutor(name, failed=lambda _: None)


def deferred(
    executor: BackgroundExecutor, work: Callable[..., _Result], *arguments: Any
) -> Callable[[], _Result]:
    """Begins work in the background; returns a function that waits for its result, at most 20 s.

    Waiting for results, not polling, gives the same homographies however the threads run.
    """
    return partial(executor.submit(partial(work, *arguments)).result, TIMEOUT_S)
