"""What is kept of a keyframe's pixels, computed in the background."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.descriptors import FrameFeatures, describe
from streamkit_stitcher.registration.patches import cut_patches, pyramid, spread_order

# Levels of a pyramid that matching needs of every frame.
LEVELS: Final = 4
# Features are the ties of photographs, whose patches do not match, and have to be precise. Frames of a video
# have to be found in time; patches then place them.
_SURVEY_WIDTH: Final = 1000
_VIDEO_WIDTH: Final = 500
_SMALL: Final = 480
_PATCHES_WIDTH: Final = 960
_GRID: Final = (25, 16)


@dataclass(frozen=True, eq=False)
class KeyframeContent:
    """Patches around the corners of a keyframe, each leading part of which is spread over all of it.

    Attributes:
        level: how often the frame was halved for its patches.
        fine: uint8[n, 17, 17], patches of that level.
        fine_centres: float64[n, 2], their centres, px of that level.
        coarse: uint8[n, 17, 17], patches of one level more.
        coarse_centres: float64[n, 2], their centres, px of that level.
        small: uint8[h, w], the frame at working size.
        scene: uint8[h, w], the frame at the size for feature matching.
        scene_factor: the reduction of `scene`.
        described: its features, if they were computed before.
    """

    level: int
    fine: GreyArray
    fine_centres: FloatArray
    coarse: GreyArray
    coarse_centres: FloatArray
    small: GreyArray
    scene: GreyArray
    scene_factor: int
    described: FrameFeatures | None

    @cached_property
    def features(self) -> FrameFeatures:
        """The features of `scene`."""
        return self.described or describe(self.scene, self.scene_factor)


def keyframe_content(
    images: Sequence[GreyArray], level: int, described: FrameFeatures | None = None, is_video: bool = False
) -> KeyframeContent:
    """Cuts patches around the best corners of an even grid of the image `level`, at working size.

    The images are kept, and must not change.
    """
    fine, scene = patch_level(images[0].shape), scene_level(images[0].shape, is_video)
    images = pyramid(images, 1 + max(level, fine + 1, scene))
    points = np.rint(even_corners(images[level], *_GRID) * 2**level + (2**level - 1) / 2)
    points = points[spread_order(len(points))]

    def cut(number: int) -> tuple[GreyArray, FloatArray]:
        # Whole pixels: interpolated patches would be smoother than the frames they are compared with.
        centres = np.rint((points - (2**number - 1) / 2) / 2**number)
        return cut_patches(images[min(number, len(images) - 1)], centres), centres

    patches = *cut(fine), *cut(fine + 1)
    return KeyframeContent(fine, *patches, images[level], images[scene], 2**scene, described)


def patch_level(shape: Sequence[int]) -> int:
    """How often a frame of (height, width) is halved for its patches; coarse ones once more.

    A patch of a halved frame is more precise than one of full size: noise is averaged out, slopes remain.
    """
    level = 0 if shape[1] < _SMALL else 1
    while shape[1] >> level > _PATCHES_WIDTH and level < LEVELS - 2:
        level += 1
    return level


def scene_level(shape: Sequence[int], is_video: bool) -> int:
    """How often a frame of (height, width) is halved for feature matching."""
    level, most = 0, _VIDEO_WIDTH if is_video else _SURVEY_WIDTH
    while shape[1] >> level > most:
        level += 1
    return level
