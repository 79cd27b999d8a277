"""The final mosaic: frames at their adjusted homographies, cut along seams and blended in bands."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, MaskArray, corners, normalised, project, translation
from streamkit_stitcher.mosaic.exposure import exposure_gains
from streamkit_stitcher.mosaic.frame_drawing import is_paintable, reduced_for, with_channels
from streamkit_stitcher.mosaic.seams import (
    LabelArray,
    SeamKind,
    footprint,
    graph_cut_labels,
    voronoi_labels,
)
from streamkit_stitcher.mosaic.tiles import ImageArray, file_array

_BLOCK: Final = 2048
_BANDS: Final = 5
# The blender rounds to integers at each level: sixteenths make that invisible.
_FINENESS: Final = 16
_REACH: Final = 3 << _BANDS
_MAX_PX: Final = 1_000_000_000
_MAX_CELLS: Final = 4_000_000
_THUMBNAIL_WIDTH: Final = 96


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
        OSError: there is no room for a temporary file.

    Source: Burt and Adelson, A multiresolution spline with application to image mosaics, ACM TOG 1983; Brown
    and Lowe, IJCV 2007.
    """
    placed = [frame for frame in frames if is_paintable(frame.to_plane, frame.shape)]
    if not placed:
        return None
    points = np.concatenate([project(frame.to_plane, corners(frame.shape)) for frame in placed])
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 1.0
    while float(np.prod((high - low) * scale + 1)) > _MAX_PX:
        scale /= 2
    offset = 0.5 * scale - 0.5
    corner = np.floor(low * scale + offset)
    from_plane = np.array([[scale, 0, offset - corner[0]], [0, scale, offset - corner[1]], [0, 0, 1]])
    width, height = (np.ceil(high * scale + offset) - corner + 1).astype(int).tolist()
    composer = _Composer(placed, load, from_plane)
    composer.plan((height, width), seam, graphics)
    shape = height, width, composer.channels
    image = np.zeros(shape, dtype=np.uint8) if height * width <= memory_px else file_array(shape)
    for top in range(0, height, _BLOCK):
        for left in range(0, width, _BLOCK):
            composer.fill(image[top : top + _BLOCK, left : left + _BLOCK], left, top)
    flat = image[:, :, 0] if composer.channels == 1 else image
    return Composition(flat, from_plane, scale, len(placed))


class _Composer:
    """Draws placed frames, first onto a coarse grid for seams and gains, then block by block."""

    def __init__(
        self, placed: Sequence[PlacedFrame], load: Callable[[int], ImageArray], from_plane: FloatArray
    ) -> None:
        self._placed = placed
        self._load = load
        self._to_mosaic = [normalised(from_plane @ frame.to_plane) for frame in placed]
        self.channels = 1 if load(placed[0].number).ndim == 2 else 3

    def plan(
        self,
        shape: tuple[int, int],
        seam: SeamKind,
        graphics: Callable[[tuple[int, int]], MaskArray | None],
    ) -> None:
        """Finds seams and gains on a coarse grid of the mosaic."""
        cut = seam is SeamKind.GRAPHCUT
        thumbnails = max(frame.shape[1] for frame in self._placed) // _THUMBNAIL_WIDTH
        # Seams around cars need cells smaller than cars.
        factor = max(1, 1 << max(0, thumbnails.bit_length() - 1) >> cut)
        factor = max(factor, 2 ** math.ceil(math.log2(max(1.0, shape[0] * shape[1] / _MAX_CELLS)) / 2))
        grid = -(-shape[0] // factor), -(-shape[1] // factor)
        shift = (1 - factor) / (2 * factor)
        lower = np.array([[1 / factor, 0, shift], [0, 1 / factor, shift], [0, 0, 1]])
        hidden = {shape: graphics(shape) for shape in {frame.shape for frame in self._placed}}
        footprints = []
        for frame, matrix in zip(self._placed, self._to_mosaic, strict=True):
            pixels = with_channels(self._load(frame.number), self.channels)
            small, to_grid = reduced_for(pixels, normalised(lower @ matrix))
            footprints.append(footprint(small, to_grid, grid, frame.fills_gaps, hidden[frame.shape]))
        self._factor = factor
        self._gains = exposure_gains(footprints)
        self._labels = (
            graph_cut_labels(footprints, grid, self._gains) if cut else voronoi_labels(footprints, grid)
        )

    def fill(self, block: ImageArray, left: int, top: int) -> None:
        """Composes one block of the mosaic, with a margin for the bands."""
        height, width = block.shape[:2]
        factor = self._factor
        rows = slice(max(0, (top - _REACH) // factor), (top + height + _REACH) // factor + 1)
        columns = slice(max(0, (left - _REACH) // factor), (left + width + _REACH) // factor + 1)
        labels = self._labels[rows, columns]
        numbers = np.unique(labels[labels >= 0])
        x, y = columns.start * factor, rows.start * factor
        result = self._blended(labels, numbers, (x, y))
        if result is None:
            return
        window = slice(top - y, top - y + height), slice(left - x, left - x + width)
        covered = self._enlarged(labels >= 0)[window] > 0
        shown = (covered & self._inside(numbers, (left, top), (width, height))).astype(np.uint8)
        if self.channels == 1:
            cv2.copyTo(result[window][:, :, 0].copy(), shown, block[:, :, 0])
        else:
            cv2.copyTo(result[window], shown, block)

    def _blended(self, labels: LabelArray, numbers: LabelArray, corner: tuple[int, int]) -> ImageArray | None:
        """The blended frames of a block, uint8[h, w, 3], at least 1; None without frames."""
        size = labels.shape[1] * self._factor, labels.shape[0] * self._factor
        blended: Any = None
        if len(numbers) == 1:
            blended = self._warped(int(numbers[0]), corner, size)
        elif len(numbers):
            blender: Any = cv2.detail.MultiBandBlender(0, _BANDS)
            blender.prepare((0, 0, *size))
            for number in numbers:
                self._feed(blender, labels == number, int(number), corner)
            blended, _ = blender.blend(None, None)
        if blended is None:
            return None
        # What no frame shows stays 0, and nothing else is.
        return np.asarray(cv2.convertScaleAbs(np.maximum(blended, _FINENESS), alpha=1 / _FINENESS), np.uint8)

    def _feed(self, blender: Any, own: MaskArray, number: int, corner: tuple[int, int]) -> None:
        """Adds one frame's part of a block, with a margin, to the blender."""
        factor = self._factor
        reach = -(-_REACH // factor)
        rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
        top, left = max(0, int(rows[0]) - reach), max(0, int(columns[0]) - reach)
        mask = self._enlarged(own[top : int(rows[-1]) + 1 + reach, left : int(columns[-1]) + 1 + reach])
        origin = corner[0] + left * factor, corner[1] + top * factor
        colours = self._warped(number, origin, (mask.shape[1], mask.shape[0]))
        blender.feed(colours, mask, (left * factor, top * factor))

    def _warped(self, number: int, corner: tuple[int, int], size: tuple[int, int]) -> npt.NDArray[np.int16]:
        """A frame with its gain in a box of the mosaic, int16[h, w, 3] in sixteenths; edges repeat."""
        pixels = with_channels(self._load(self._placed[number].number), self.channels)
        frame, matrix = reduced_for(pixels, self._to_mosaic[number])
        to_box = normalised(translation(-np.array(corner)) @ matrix)
        warped = cv2.warpPerspective(frame, to_box, size, borderMode=cv2.BORDER_REPLICATE)
        factors: Any = (*(self._gains[number] * _FINENESS).tolist(), 1.0)
        colours = with_channels(np.asarray(warped, dtype=np.uint8), 3)
        return np.asarray(cv2.multiply(colours, factors, dtype=cv2.CV_16S), dtype=np.int16)

    def _enlarged(self, cells: MaskArray) -> ImageArray:
        """Cells of the planning grid as pixels of the mosaic, uint8, 255 where set."""
        grey = cells.astype(np.uint8) * np.uint8(255)
        size = cells.shape[1] * self._factor, cells.shape[0] * self._factor
        return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)

    def _inside(self, numbers: LabelArray, corner: tuple[int, int], size: tuple[int, int]) -> MaskArray:
        """Pixels inside any of the frames; the coarse grid alone would leave a jagged border."""
        mask = np.zeros((size[1], size[0]), dtype=np.uint8)
        for number in numbers:
            outline = project(self._to_mosaic[number], corners(self._placed[number].shape)) - np.array(corner)
            cv2.fillConvexPoly(mask, np.rint(outline * 16).astype(np.int32), 1, cv2.LINE_8, 4)
        return mask > 0
