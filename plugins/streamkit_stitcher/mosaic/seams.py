"""Seams: which frame each part of the final mosaic shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, MaskArray, corners, normalised, project, translation
from streamkit_stitcher.mosaic.frame_drawing import depth_inside, with_channels
from streamkit_stitcher.mosaic.tiles import ImageArray

LabelArray = npt.NDArray[np.int32]

_MAX_CUT_CELLS: Final = 8_000_000
_BAND: Final = 1 / 8
_PRECEDENCE: Final = 300
# Differences of this many grey levels cost as much as the length of a seam. Below are noise and flat ground,
# around which a seam would wind, and which make the maximum flow ten times as slow.
_NOISE: Final = 10.0
# Depth of what is shown only where no frame has anything else: graphics over the ground.
LAST_RESORT: Final = 1


class SeamKind(StrEnum):
    """How overlapping frames are cut.

    `voronoi` shows each part from the frame in which it is deepest; `graphcut` moves those seams, by up to an
    eighth of a frame, to where the frames look alike: around cars and trees.
    """

    VORONOI = "voronoi"
    GRAPHCUT = "graphcut"


@dataclass(frozen=True, eq=False)
class Footprint:
    """A frame on the planning grid.

    Attributes:
        left: first column of its box.
        top: first row of its box.
        thumbnail: uint8[h, w, 3], the frame warped into its box.
        depth: int32[h, w], depth of each cell inside the frame, 0 outside, LAST_RESORT under graphics.
        fills_gaps: whether every other frame has precedence.
    """

    left: int
    top: int
    thumbnail: ImageArray
    depth: LabelArray
    fills_gaps: bool = False

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the grid that it covers."""
        height, width = self.depth.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


def footprint(
    thumbnail: ImageArray,
    to_grid: FloatArray,
    grid: tuple[int, int],
    fills_gaps: bool,
    graphics: MaskArray | None = None,
) -> Footprint:
    """Warps a frame's thumbnail, uint8[h, w] or [h, w, 3], onto the planning grid of (rows, columns).

    `graphics` are the pixels of the frame that do not show the ground, bool of any size.
    """
    shape = (thumbnail.shape[0], thumbnail.shape[1])
    outline = project(to_grid, corners(shape))
    left, top = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, np.array(grid[::-1]) - 1).tolist()
    right, bottom = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 1, 1, grid[::-1]).tolist()
    size = max(1, right - left), max(1, bottom - top)
    to_box = normalised(translation(-np.array([left, top])) @ to_grid)
    warped = cv2.warpPerspective(thumbnail, to_box, size, borderMode=cv2.BORDER_REPLICATE)
    flat = depth_inside(shape)
    depth = cv2.warpPerspective(flat, to_box, size, flags=cv2.INTER_LINEAR).astype(np.int32)
    depth[depth > 0] += LAST_RESORT + (0 if fills_gaps else _PRECEDENCE)
    if graphics is not None:
        small = cv2.resize(graphics.astype(np.float32), flat.shape[::-1], interpolation=cv2.INTER_AREA)
        hidden = cv2.warpPerspective(small, to_box, size) > 0
        depth[hidden & (depth > 0)] = LAST_RESORT
    return Footprint(left, top, with_channels(np.asarray(warped, np.uint8), 3), depth, fills_gaps)


def voronoi_labels(footprints: Sequence[Footprint], grid: tuple[int, int]) -> LabelArray:
    """The frame in which each cell is deepest, int32[rows, columns], -1 where there is none.

    Cells at the outer border of a frame are its own, too, so that the mosaic's outline is not jagged.
    """
    labels = np.full(grid, -1, dtype=np.int32)
    deepest = np.zeros(grid, dtype=np.int32)
    for number, own in enumerate(footprints):
        better = own.depth > deepest[own.window]
        labels[own.window][better] = number
        deepest[own.window][better] = own.depth[better]
    for number, own in enumerate(footprints):
        reached = cv2.dilate((own.depth > 0).astype(np.uint8), np.ones((3, 3), dtype=np.uint8)) > 0
        labels[own.window][reached & (labels[own.window] < 0)] = number
    return labels


def graph_cut_labels(footprints: Sequence[Footprint], grid: tuple[int, int], gains: FloatArray) -> LabelArray:
    """Seams along lines where overlapping frames look alike, around cars and leaning houses.

    They stay near those of `voronoi_labels`, which are kept where there are too many frames for memory: each
    part comes from a frame taken from nearly above, and only neighbours are compared. `gains` float64[n, 3]
    equalise the exposure.

    The cost is the difference of colours alone: COST_COLOR_GRAD divides it by the gradient, so that seams
    prefer edges, and cut leaves and pipes.

    Source: Kwatra et al., Graphcut textures, SIGGRAPH 2003, as in cv2.detail.
    """
    labels = voronoi_labels(footprints, grid)
    candidates = [
        (number, *found)
        for number, own in enumerate(footprints)
        if (found := _candidate_mask(own, number, labels))
    ]
    if len(candidates) < 2 or sum(mask.size for _, _, mask in candidates) > _MAX_CUT_CELLS:
        return labels
    images, origins = [], []
    for number, (rows, columns), _ in candidates:
        own = footprints[number]
        images.append((own.thumbnail[rows, columns] * (gains[number] / _NOISE)).astype(np.float32))
        origins.append((own.left + columns.start, own.top + rows.start))
    on_device: Any = cv2.UMat  # the stubs lack arrays
    masks = [on_device(mask) for _, _, mask in candidates]
    finder: Any = cv2.detail.GraphCutSeamFinder("COST_COLOR")
    found = finder.find(images, origins, masks)
    for (number, _, _), (left, top), cut in zip(
        candidates, origins, masks if found is None else found, strict=True
    ):
        shown = np.asarray(cut.get()) > 0
        labels[top : top + shown.shape[0], left : left + shown.shape[1]][shown] = number
    return labels


def _candidate_mask(
    own: Footprint, number: int, labels: LabelArray
) -> tuple[tuple[slice, slice], ImageArray] | None:
    """Where a frame may be shown: rows and columns of its box, and their mask; None for nowhere."""
    cells = labels[own.window] == number
    if not cells.any():
        return None
    near = cells
    if not own.fills_gaps:
        apart = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, 3)
        near = cells | ((apart <= max(2.0, _BAND * min(cells.shape))) & (own.depth > LAST_RESORT))
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    part = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
    return part, np.where(near[part], 255, 0).astype(np.uint8)
