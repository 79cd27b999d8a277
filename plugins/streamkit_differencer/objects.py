"""Objects from foreground: sub-sampling by vote, one morphological filter, clusters, centroids.

Cells are the pixels of the foreground sub-sampled to `CELL_SIZE` frame pixels. Clustering works on cells and
measuring on the foreground itself, so that boxes and centroids keep its precision.

Source: Zhang, Liu, Qu, section 2.2, last two paragraphs; for the criterion J_mn see
`streamkit_differencer.clusters`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import CORNERS, ByteImage, Corners, FloatArray, LabelImage
from streamkit_differencer.clusters import label_by_gap, merge_by_scatter
from streamkit_differencer.mask_values import HIGHEST_BACKGROUND, MOVING
from streamkit_differencer.measurement import (
    BOTTOM,
    CHANGED,
    LEFT,
    PIXELS,
    SUM_X,
    SUM_Y,
    downsampled_by_vote,
    measure_objects,
)
from streamkit_differencer.settings import Criterion, ObjectSettings
from streamkit_kernels import UINT8, kernel

CELL_SIZE = 4
# Empty cells around the foreground, which closing and merging need.
MARGIN_CELLS = 2
_SQUARE = np.ones((3, 3), np.uint8)
# At full resolution the tolerance is 0, without hysteresis: objects are more fragmented.
GAP_FULL, GAP_REDUCED = 3, 1
# Clustering is quadratic: more fragments than this are noise, and the largest are kept.
MOST_FRAGMENTS = 1500
# An object of which this share changed moves as a whole.
MOVES = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Objects:
    """Objects of a frame, in pixels at full resolution, largest first.

    Each is a region of the image that moves: one thing, a part of one, or several that are close together.

    Attributes:
        centroids: float64[n, 2], x y, the centre of the foreground.
        boxes: float64[n, 4], x0 y0 x1 y1, the outer edges of the foreground.
        areas: float64[n], foreground, px.
        changes: float64[n], share of the foreground that changed within quiet_frames, 0 to 1.
        confidences: float64[n], 0 to 1; empty until they are computed.
        dropped: number of objects above `max_objects`.
    """

    centroids: FloatArray
    boxes: FloatArray
    areas: FloatArray
    changes: FloatArray
    dropped: int = 0
    confidences: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.areas)


NO_OBJECTS = Objects(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


def find_objects(
    foreground: ByteImage, scale: int, settings: ObjectSettings, most: int | None = None
) -> Objects:
    """Objects in the foreground of one frame.

    Args:
        foreground: uint8[h, w], see `mask_values`; what is too small for an object is cleared.
        scale: frame pixels per pixel of `foreground`: 1, 2 or 4.
        settings: what counts as an object.
        most: number of objects to keep, the largest, instead of `max_objects`.
    """
    cells = cells_of(foreground, scale)
    left, top, width, height = cv2.boundingRect(cells)
    if not width:
        return NO_OBJECTS
    gap = settings.merge_gap
    if gap < 0:
        gap = GAP_FULL if scale == 1 else GAP_REDUCED
    margin = max(MARGIN_CELLS, gap)
    first_row, first_column = max(0, top - margin), max(0, left - margin)
    inside = cells[first_row : top + height + margin, first_column : left + width + margin]
    labels, count = clustered(inside, settings.merge_criterion, gap)
    inside, labels = closed(inside, labels)
    place = first_row, first_column, CELL_SIZE // scale
    table = measure_objects(
        foreground, inside, labels, count, *place, settings.min_area, HIGHEST_BACKGROUND + 1
    )
    table = table[table[:, PIXELS] > 0.0]
    changes = table[:, CHANGED] / table[:, PIXELS]
    moving = np.flatnonzero(changes >= settings.min_change)
    order = moving[np.argsort(-table[moving, PIXELS], kind="stable")]
    kept = order[: settings.max_objects if most is None else most]
    rows = table[kept]
    pixels = rows[:, PIXELS]
    centroids = rows[:, SUM_X : SUM_Y + 1] / pixels[:, None] * scale + (scale - 1) / 2
    boxes = (rows[:, LEFT : BOTTOM + 1] + (0.0, 0.0, 1.0, 1.0)) * scale - 0.5
    return Objects(centroids, boxes, pixels * scale**2, changes[kept], order.size - kept.size)


def clustered(cells: ByteImage, criterion: Criterion, gap: int) -> tuple[LabelImage, int]:
    """The object of each cell, int32[h, w] from 1; and the number of objects."""
    if criterion is Criterion.GAP:
        return label_by_gap(cells, gap)
    fragment, areas, centres = fragments(cells)
    cluster = merge_by_scatter(centres, areas, gap)
    labels = np.concatenate([[0], cluster + 1]).astype(np.int32)[fragment]
    return labels, int(cluster.max()) + 1


def closed(cells: ByteImage, labels: LabelImage) -> tuple[ByteImage, LabelImage]:
    """Fills gaps of one or two cells within each object: the one morphological filter.

    Closing before clustering would merge two cars that pass each other.

    Args:
        cells: uint8[h, w], mask.
        labels: int32[h, w], the object of each cell, from 1.

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


def most_confident(objects: Objects, most: int) -> Objects:
    """The `most` objects of the highest confidence, in their order.

    A choice by size would leave out the same small objects in every frame of dense traffic, and let a flood
    of noise, which is large and new, push out older objects.
    """
    if len(objects) <= most:
        return objects
    kept = np.sort(np.argsort(-objects.confidences, kind="stable")[:most])
    return Objects(
        objects.centroids[kept],
        objects.boxes[kept],
        objects.areas[kept],
        objects.changes[kept],
        objects.dropped + len(objects) - most,
        objects.confidences[kept],
    )


def cells_of(foreground: ByteImage, scale: int) -> ByteImage:
    """Sub-samples the foreground to cells by vote: uint8, 255 where set."""
    if scale == CELL_SIZE:
        return cast("ByteImage", cv2.threshold(foreground, HIGHEST_BACKGROUND, 255, cv2.THRESH_BINARY)[1])
    cells = downsampled_by_vote(foreground, HIGHEST_BACKGROUND + 1)
    return cells if 2 * scale == CELL_SIZE else downsampled_by_vote(cells, HIGHEST_BACKGROUND + 1)


def fragments(cells: ByteImage) -> tuple[LabelImage, FloatArray, FloatArray]:
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


def mark_moving(mask: ByteImage, objects: Objects, scale: int) -> None:
    """Marks all of an object as moving where most of it changed: the middle of a slow one looks as before.

    Args:
        mask: uint8[h, w], see `mask_values`; updated in place.
        objects: found in it.
        scale: frame pixels per pixel of `mask`.
    """
    moving = objects.boxes[objects.changes >= MOVES]
    _mark(mask, np.rint((moving + 0.5) / scale).astype(np.int64))


@kernel(UINT8, CORNERS)
def _mark(mask: ByteImage, corners: Corners) -> None:
    for left, top, right, bottom in corners:
        for row in range(top, min(bottom, mask.shape[0])):
            for column in range(left, min(right, mask.shape[1])):
                if mask[row, column] > HIGHEST_BACKGROUND:
                    mask[row, column] = MOVING
