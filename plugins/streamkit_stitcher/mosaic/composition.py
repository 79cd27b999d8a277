"""The final mosaic: frames at their adjusted homographies, cut along seams and blended in bands."""

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, MaskArray, corners, normalised, project, translation
from streamkit_stitcher.mosaic.exposure import gains
from streamkit_stitcher.mosaic.frame_store import thumbnail_factor
from streamkit_stitcher.mosaic.mosaic import is_paintable, reduced_for, with_channels
from streamkit_stitcher.mosaic.seams import (
    Footprint,
    LabelArray,
    SeamKind,
    footprint,
    graph_cut_labels,
    voronoi_labels,
)
from streamkit_stitcher.mosaic.tiles import ImageArray

_BLOCK: Final = 2048
_BANDS: Final = 5
# The blender rounds to integers at each level: sixteenths make that invisible.
_FINENESS: Final = 16
_REACH: Final = 3 << _BANDS
_LARGEST_PX: Final = 1_000_000_000
_LARGEST_GRID: Final = 4_000_000


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """A frame of the final mosaic.

    Attributes:
        number: of the frame in its store, -1 if not stored.
        shape: (height, width), px.
        to_plane: float64[3, 3], its pixels to the plane.
        fills_gaps: whether it shows only where no other frame does.
    """

    number: int
    shape: tuple[int, int]
    to_plane: FloatArray
    fills_gaps: bool = False


@dataclass(frozen=True, eq=False)
class Composition:
    """A composed mosaic.

    Attributes:
        image: uint8[h, w] or uint8[h, w, 3] BGR, black where there is no frame; may be a memory map.
        from_plane: float64[3, 3], the plane to its pixels.
        scale: its pixels per px of the plane.
        frames: number of frames in it.
    """

    image: ImageArray
    from_plane: FloatArray
    scale: float
    frames: int


def compose(
    frames: Sequence[PlacedFrame],
    load: Callable[[int], ImageArray],
    seam: SeamKind,
    memory_px: int,
    graphics: Callable[[tuple[int, int]], MaskArray | None] = lambda _: None,
) -> Composition | None:
    """Composes frames, block by block: exposure gains, seams, and five bands blended across the seams.

    Each part of the ground comes from one frame, so that moving objects show once; only low frequencies mix
    across a seam. A mosaic above `memory_px` goes to a temporary file. None where no frame can be placed.
    `graphics` returns the pixels of frames of (height, width) that do not show the ground.

    Raises:
        OSError: a temporary file is full.

    Source: Burt and Adelson, A multiresolution spline with application to image mosaics, ACM TOG 1983; Brown
    and Lowe, IJCV 2007.
    """
    placed = [frame for frame in frames if is_paintable(frame.to_plane, frame.shape)]
    if not placed:
        return None
    points = np.concatenate([project(frame.to_plane, corners(frame.shape)) for frame in placed])
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 1.0
    while float(np.prod((high - low) * scale + 1)) > _LARGEST_PX:
        scale /= 2
    offset = 0.5 * scale - 0.5
    corner = np.floor(low * scale + offset)
    from_plane = np.array([[scale, 0, offset - corner[0]], [0, scale, offset - corner[1]], [0, 0, 1]])
    width, height = (np.ceil(high * scale + offset) - corner + 1).astype(int).tolist()
    plan = _plan(placed, load, from_plane, (height, width), seam, graphics)
    image = _empty((height, width, plan.channels), memory_px)
    for top in range(0, height, _BLOCK):
        for left in range(0, width, _BLOCK):
            _fill(image[top : top + _BLOCK, left : left + _BLOCK], left, top, plan, load)
    flat = image[:, :, 0] if plan.channels == 1 else image
    return Composition(flat, from_plane, scale, len(placed))


@dataclass(frozen=True, eq=False)
class _Plan:
    placed: Sequence[PlacedFrame]
    to_mosaic: Sequence[FloatArray]
    labels: LabelArray
    factor: int
    gains: FloatArray
    channels: int


def _empty(shape: tuple[int, int, int], memory_px: int) -> ImageArray:
    if shape[0] * shape[1] <= memory_px:
        return np.zeros(shape, dtype=np.uint8)
    with tempfile.TemporaryFile(prefix="streamkit-mosaic-") as file:
        # The memory map keeps the unlinked file open.
        return np.memmap(file, dtype=np.uint8, mode="w+", shape=shape)


def _plan(
    placed: Sequence[PlacedFrame],
    load: Callable[[int], ImageArray],
    from_plane: FloatArray,
    shape: tuple[int, int],
    seam: SeamKind,
    graphics: Callable[[tuple[int, int]], MaskArray | None],
) -> _Plan:
    """Finds seams and gains on a coarse grid of the mosaic."""
    factor = thumbnail_factor(max(frame.shape[1] for frame in placed))
    if seam is SeamKind.GRAPHCUT:
        # Seams around cars need cells smaller than cars.
        factor = max(1, factor // 2)
    factor = max(factor, 2 ** math.ceil(math.log2(max(1.0, shape[0] * shape[1] / _LARGEST_GRID)) / 2))
    grid = -(-shape[0] // factor), -(-shape[1] // factor)
    lower = np.array(
        [
            [1 / factor, 0, (1 - factor) / (2 * factor)],
            [0, 1 / factor, (1 - factor) / (2 * factor)],
            [0, 0, 1],
        ]
    )
    channels = 0
    footprints: list[Footprint] = []
    hidden = {shape: graphics(shape) for shape in {frame.shape for frame in placed}}
    to_mosaic = [normalised(from_plane @ frame.to_plane) for frame in placed]
    for frame, matrix in zip(placed, to_mosaic, strict=True):
        pixels = load(frame.number)
        channels = channels or (1 if pixels.ndim == 2 else 3)
        small, to_grid = reduced_for(with_channels(pixels, channels), normalised(lower @ matrix))
        small = small.reshape(*small.shape[:2], -1)
        footprints.append(footprint(small, to_grid, grid, frame.fills_gaps, hidden[frame.shape]))
    evened = gains(footprints)
    cut = seam is SeamKind.GRAPHCUT
    labels = graph_cut_labels(footprints, grid, evened) if cut else voronoi_labels(footprints, grid)
    return _Plan(placed, to_mosaic, labels, factor, evened, channels)


def _fill(block: ImageArray, left: int, top: int, plan: _Plan, load: Callable[[int], ImageArray]) -> None:
    """Composes one block of the mosaic, with a margin for the bands."""
    height, width = block.shape[:2]
    rows = slice(max(0, (top - _REACH) // plan.factor), (top + height + _REACH) // plan.factor + 1)
    columns = slice(max(0, (left - _REACH) // plan.factor), (left + width + _REACH) // plan.factor + 1)
    labels = plan.labels[rows, columns]
    numbers = np.unique(labels[labels >= 0])
    if not len(numbers):
        return
    x, y = columns.start * plan.factor, rows.start * plan.factor
    result = _blended(labels, numbers, (x, y), plan, load)
    if result is None:
        return
    window = slice(top - y, top - y + height), slice(left - x, left - x + width)
    result = result[window]
    covered = _enlarged(labels >= 0, plan.factor)[window] > 0
    shown = (covered & _inside(numbers, (left, top), (width, height), plan)).astype(np.uint8)
    if plan.channels == 1:
        cv2.copyTo(result[:, :, 0].copy(), shown, block[:, :, 0])
    else:
        cv2.copyTo(result, shown, block)


def _blended(
    labels: LabelArray,
    numbers: LabelArray,
    corner: tuple[int, int],
    plan: _Plan,
    load: Callable[[int], ImageArray],
) -> ImageArray | None:
    """The blended frames of a block, uint8[h, w, 3]."""
    size = labels.shape[1] * plan.factor, labels.shape[0] * plan.factor
    if len(numbers) == 1:
        return _rounded(_warped(int(numbers[0]), corner, size, plan, load))
    blender: Any = cv2.detail.MultiBandBlender(0, _BANDS)
    blender.prepare((0, 0, *size))
    for number in numbers:
        _feed(blender, labels == number, int(number), corner, plan, load)
    blended, _ = blender.blend(None, None)
    return None if blended is None else _rounded(np.asarray(blended))


def _rounded(sixteenths: npt.NDArray[np.int16]) -> ImageArray:
    return np.asarray(cv2.convertScaleAbs(np.maximum(sixteenths, 0), alpha=1 / _FINENESS), dtype=np.uint8)


def _warped(
    number: int,
    corner: tuple[int, int],
    size: tuple[int, int],
    plan: _Plan,
    load: Callable[[int], ImageArray],
) -> npt.NDArray[np.int16]:
    """A frame with its gain in a box of the mosaic, int16[h, w, 3] in sixteenths; edges repeat."""
    shift = translation(-np.array(corner))
    frame, matrix = reduced_for(
        with_channels(load(plan.placed[number].number), plan.channels), plan.to_mosaic[number]
    )
    warped = cv2.warpPerspective(frame, normalised(shift @ matrix), size, borderMode=cv2.BORDER_REPLICATE)
    colours = warped if warped.ndim == 3 else cv2.cvtColor(warped, cv2.COLOR_GRAY2BGR)
    factors: Any = (*np.broadcast_to(plan.gains[number] * _FINENESS, 3).tolist(), 1.0)
    return np.asarray(cv2.multiply(colours, factors, dtype=cv2.CV_16S), dtype=np.int16)


def _enlarged(cells: MaskArray, factor: int) -> ImageArray:
    """Cells of the planning grid as pixels of the mosaic, uint8, 255 where set."""
    grey = cells.astype(np.uint8) * np.uint8(255)
    size = cells.shape[1] * factor, cells.shape[0] * factor
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _inside(numbers: LabelArray, corner: tuple[int, int], size: tuple[int, int], plan: _Plan) -> MaskArray:
    """Pixels inside any of the frames; the coarse grid alone would leave a jagged border."""
    mask = np.zeros((size[1], size[0]), dtype=np.uint8)
    for number in numbers:
        outline = project(plan.to_mosaic[number], corners(plan.placed[number].shape)) - np.array(corner)
        cv2.fillConvexPoly(mask, np.rint(outline * 16).astype(np.int32), 1, cv2.LINE_8, 4)
    return mask > 0


def _feed(
    blender: Any,
    own: MaskArray,
    number: int,
    corner: tuple[int, int],
    plan: _Plan,
    load: Callable[[int], ImageArray],
) -> None:
    """Adds one frame's part of a block, with a margin, to the blender."""
    factor = plan.factor
    reach = -(-_REACH // factor)
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    top, bottom = max(0, int(rows[0]) - reach), min(own.shape[0], int(rows[-1]) + 1 + reach)
    left, right = max(0, int(columns[0]) - reach), min(own.shape[1], int(columns[-1]) + 1 + reach)
    mask = _enlarged(own[top:bottom, left:right], factor)
    origin = corner[0] + left * factor, corner[1] + top * factor
    colours = _warped(number, origin, (mask.shape[1], mask.shape[0]), plan, load)
    blender.feed(colours, mask, (left * factor, top * factor))
