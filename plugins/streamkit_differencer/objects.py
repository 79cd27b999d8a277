"""Objects from foreground: sub-sampling by vote, one morphological filter, clusters, centroids.

Cells are the pixels of the foreground sub-sampled to `CELL_SIZE` frame pixels; clustering works on them and
measuring on the foreground itself, so that boxes and centroids keep the finer grid's precision.

Source: Zhang, Liu, Qu, section 2.2, last two paragraphs; where the criterion J_mn is not defined, see
`streamkit_differencer.clusters`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.clusters import Criterion, label_by_gap, merge_by_scatter
from streamkit_differencer.measuring import (
    BOTTOM,
    CHANGED,
    LEFT,
    PIXELS,
    RIGHT,
    SUM_X,
    SUM_Y,
    TOP,
    halved,
    measured,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    IntImage = NDArray[np.int32]
    FloatArray = NDArray[np.float64]

CELL_SIZE = 4
# Empty cells around what is looked at, so that closing and merging meet no border of their own.
MARGIN_CELLS = 2
_SQUARE = np.ones((3, 3), np.uint8)
# At full resolution there is no tolerance, and without it no growth: things come in fragments.
GAP_FULL, GAP_REDUCED = 3, 1
# Clustering is quadratic: more fragments than this are noise, and the largest are kept.
MOST_FRAGMENTS = 1500
# Marks below this are no foreground: shadow.
LOWEST_MARK = 100


@dataclass(frozen=True, slots=True)
class ObjectSettings:
    """What counts as an object.

    Attributes:
        min_area: cells an object must have.
        merge_gap: cells between fragments of one object; chosen by the scale where it is negative.
        criterion: what J_mn is.
        min_score: share of an object's foreground that must have changed lately; 0 keeps what stands still.
        max_objects: how many are kept: of a frame's the surest, of those that nothing judged the largest.
        median_px: width of the median filter that cleans the foreground, frame px; 0 for none.
        fill_holes: whether holes in the foreground are filled.
        parallax: largest height of a thing over the camera's height above it, that is taken for parallax and
            left out; 0 keeps everything.
    """

    min_area: int = 3
    merge_gap: int = -1
    criterion: Criterion = Criterion.GAP
    min_score: float = 0.25
    max_objects: int = 50
    median_px: int = 5
    fill_holes: bool = False
    parallax: float = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Objects:
    """What was found in a frame, in pixels of the frame at full resolution, largest first.

    Attributes:
        centroids: float64[n, 2], x y, the centre of the foreground.
        boxes: float64[n, 4], x0 y0 x1 y1, the outer edges of the foreground.
        areas: float64[n], foreground, px.
        scores: float64[n], share of the foreground that changed lately, 0 to 1.
        confidences: float64[n], how sure each is, 0 to 1; empty until they were judged.
        dropped: objects left out because there were more than `max_objects`.
    """

    centroids: FloatArray
    boxes: FloatArray
    areas: FloatArray
    scores: FloatArray
    dropped: int = 0
    confidences: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.areas)


NOTHING = Objects(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


def find_objects(foreground: ByteImage, scale: int, settings: ObjectSettings) -> Objects:
    """Objects in the foreground of one frame.

    Args:
        foreground: uint8[h, w], 0 for background, 255 for foreground that changed lately, else foreground.
        scale: frame pixels per pixel of `foreground`: 1, 2 or 4.
        settings: what counts as an object.
    """
    cells = cells_of(foreground, scale)
    left, top, width, height = cv2.boundingRect(cells)
    if not width:
        return NOTHING
    if settings.merge_gap < 0:
        settings = replace(settings, merge_gap=GAP_FULL if scale == 1 else GAP_REDUCED)
    margin = max(MARGIN_CELLS, settings.merge_gap)
    first_row, first_column = max(0, top - margin), max(0, left - margin)
    inside = cells[first_row : top + height + margin, first_column : left + width + margin]
    labels, count = clustered(inside, settings)
    inside, labels = closed(inside, labels)
    step = CELL_SIZE // scale
    table = measured(
        foreground, inside, labels, count, first_row, first_column, step, settings.min_area, LOWEST_MARK + 1
    )
    return selected(objects_of(table[table[:, PIXELS] > 0.0], scale), settings)


def clustered(cells: ByteImage, settings: ObjectSettings) -> tuple[IntImage, int]:
    """The object that each cell belongs to, int32[h, w] from 1; and how many there are."""
    if settings.criterion is Criterion.GAP:
        return label_by_gap(cells, settings.merge_gap)
    fragment, areas, centres = fragments(cells)
    cluster = merge_by_scatter(centres, areas, settings.merge_gap)
    labels = np.concatenate([[0], cluster + 1]).astype(np.int32)[fragment]
    return labels, int(cluster.max()) + 1


def closed(cells: ByteImage, labels: IntImage) -> tuple[ByteImage, IntImage]:
    """Fills gaps of one or two cells within each object: the one morphological filter.

    Filled before things are told apart, a gap would make one of two cars that pass each other.

    Args:
        cells: uint8[h, w], 255 for cells of the foreground.
        labels: int32[h, w], the object that each belongs to, from 1.

    Returns:
        Both with the gaps filled.
    """
    whole = cast("ByteImage", cv2.morphologyEx(cells, cv2.MORPH_CLOSE, _SQUARE))
    added = np.flatnonzero((whole != cells) & (labels == 0))
    if not added.size:
        return whole, labels
    near = cv2.dilate(labels.astype(np.float32), _SQUARE)
    filled = labels.copy()
    filled.ravel()[added] = near.ravel()[added]
    return whole, filled


def selected(objects: Objects, settings: ObjectSettings) -> Objects:
    """The objects that move, largest first, and no more than `max_objects` of them."""
    moving = np.flatnonzero(objects.scores >= settings.min_score)
    order = moving[np.argsort(-objects.areas[moving], kind="stable")]
    kept = order[: settings.max_objects]
    return replace(chosen(objects, kept), dropped=order.size - kept.size)


def surest(objects: Objects, most: int) -> Objects:
    """No more than `most` of the objects: the surest, in the order that they are in.

    By size the same small things would be left out of every frame of dense traffic, and a flood of noise,
    which is large and new, would push out what has been there for long.
    """
    if len(objects) <= most:
        return objects
    kept = np.sort(np.argsort(-objects.confidences, kind="stable")[:most])
    return replace(
        chosen(objects, kept),
        confidences=objects.confidences[kept],
        dropped=objects.dropped + len(objects) - most,
    )


def chosen(objects: Objects, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Objects:
    """Some of the objects."""
    return Objects(
        objects.centroids[rows],
        objects.boxes[rows],
        objects.areas[rows],
        objects.scores[rows],
        dropped=objects.dropped,
    )


def cells_of(foreground: ByteImage, scale: int) -> ByteImage:
    """Sub-samples the foreground to cells by vote: uint8, 255 for set."""
    if scale == CELL_SIZE:
        return cast("ByteImage", cv2.threshold(foreground, LOWEST_MARK, 255, cv2.THRESH_BINARY)[1])
    cells = halved(foreground, LOWEST_MARK + 1)
    return cells if 2 * scale == CELL_SIZE else halved(cells, LOWEST_MARK + 1)


def fragments(cells: ByteImage) -> tuple[IntImage, FloatArray, FloatArray]:
    """Connected components of the cells.

    Returns:
        labels int32[h, w], 0 for none and then from 1; areas float64[n] in cells; centres float64[n, 2].
    """
    count, labels, statistics, centres = cv2.connectedComponentsWithStats(cells, connectivity=8)
    areas = statistics[1:, cv2.CC_STAT_AREA].astype(np.float64)
    if count - 1 > MOST_FRAGMENTS:
        kept = np.sort(np.argsort(-areas, kind="stable")[:MOST_FRAGMENTS])
        renumber = np.zeros(count, np.int32)
        renumber[kept + 1] = np.arange(1, kept.size + 1)
        labels, centres, areas = renumber[labels], centres[[0, *(kept + 1)]], areas[kept]
    return labels.astype(np.int32, copy=False), areas, centres[1:].astype(np.float64)


def objects_of(table: FloatArray, scale: int) -> Objects:
    """Objects in pixels of the frame, from what was measured of them, see `measuring.measured`."""
    pixels = table[:, PIXELS]
    centroids = table[:, [SUM_X, SUM_Y]] / pixels[:, None]
    boxes = (table[:, [LEFT, TOP, RIGHT, BOTTOM]] + (0.0, 0.0, 1.0, 1.0)) * scale - 0.5
    return Objects(centroids * scale + (scale - 1) / 2, boxes, pixels * scale**2, table[:, CHANGED] / pixels)
