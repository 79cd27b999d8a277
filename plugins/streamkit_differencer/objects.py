"""Objects from foreground: sub-sampling by vote, one morphological filter, clusters, centroids.

Cells are the pixels of the foreground sub-sampled to `CELL_SIZE` frame pixels. Clustering works on cells and
measuring on the foreground itself, so that boxes and centroids keep its precision.

Source: Zhang, Liu, Qu, section 2.2, last two paragraphs; for the criterion J_mn see
`streamkit_differencer.clusters`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, Indices, above
from streamkit_differencer.clusters import clustered
from streamkit_differencer.foreground import MAX_BACKGROUND, MOVING
from streamkit_differencer.measurement import (
    BOTTOM,
    CHANGED,
    LEFT,
    PIXELS,
    SUM_X,
    SUM_Y,
    measure_objects,
    votes,
    with_neighbours,
)
from streamkit_differencer.settings import ObjectSettings

CELL_SIZE = 4
_SQUARE = np.ones((3, 3), np.uint8)
# At full resolution the tolerance is 0, without hysteresis: objects are more fragmented.
GAP_FULL, GAP_REDUCED = 3, 1
# Empty cells around the foreground, which closing and merging need.
MARGIN_CELLS = 2
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
        confidences: float64[n], 0 to 1; zeros until they are computed.
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


COLUMNS = ("centroids", "boxes", "areas", "changes", "confidences")
NO_OBJECTS = Objects(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


def find_objects(
    foreground: ByteImage, scale: int, settings: ObjectSettings, max_objects: int | None = None
) -> Objects:
    """Objects in the foreground of one frame.

    Args:
        foreground: uint8[h, w], see `foreground`; what is too small for an object is cleared.
        scale: frame pixels per pixel of `foreground`: 1, 2 or 4.
        settings: what counts as an object.
        max_objects: number of objects to keep, the largest; None for that of the settings.
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
    # Closing before clustering would merge two cars that pass each other.
    inside = cast("ByteImage", cv2.morphologyEx(inside, cv2.MORPH_CLOSE, _SQUARE))
    labels = with_neighbours(inside, labels)
    grid = first_row, first_column, CELL_SIZE // scale
    table = measure_objects(foreground, inside, labels, count, *grid, settings.min_area)
    table = table[table[:, PIXELS] > 0.0]
    table = table[(table[:, CHANGED] / table[:, PIXELS] >= settings.min_change) | settings.stopped]
    largest_first = np.argsort(-table[:, PIXELS], kind="stable")
    kept = largest_first[: max_objects or settings.max_objects]
    return replace(measured(table[kept], scale), dropped=len(table) - len(kept))


def measured(table: FloatArray, scale: int) -> Objects:
    """The objects of rows of `measurement.measure_objects`; `scale` is frame pixels per pixel there."""
    pixels = table[:, PIXELS]
    centroids = table[:, SUM_X : SUM_Y + 1] / pixels[:, None] * scale + (scale - 1) / 2
    boxes = (table[:, LEFT : BOTTOM + 1] + (0.0, 0.0, 1.0, 1.0)) * scale - 0.5
    changes = table[:, CHANGED] / pixels
    return Objects(centroids, boxes, pixels * scale**2, changes, confidences=np.zeros(len(table)))


def most_confident(objects: Objects, count: int) -> Objects:
    """The `count` objects of the highest confidence, of more than that, in their order.

    A choice by size would leave out the same small objects in every frame of dense traffic, and let a flood
    of noise, which is large and new, push out older objects.
    """
    kept = np.sort(np.argsort(-objects.confidences, kind="stable")[:count])
    return replace(chosen(objects, kept), dropped=objects.dropped + len(objects) - count)


def chosen(objects: Objects, numbers: Indices) -> Objects:
    """Some of the objects, int64[n], in this order."""
    return replace(objects, **{name: getattr(objects, name)[numbers] for name in COLUMNS})


def cells_of(foreground: ByteImage, scale: int) -> ByteImage:
    """Sub-samples the foreground to cells by vote: uint8, 255 where at least half of the pixels are set.

    Each halving is a vote of two by two pixels; beyond the border nothing is set.
    """
    cells = above(foreground, MAX_BACKGROUND)
    while scale < CELL_SIZE:
        cells, scale = above(votes(cells), 1), 2 * scale
    return cells


def mark_moving(mask: ByteImage, objects: Objects, scale: int) -> None:
    """Marks all of an object as moving where most of it changed: the middle of a slow one looks as before.

    Args:
        mask: uint8[h, w], see `foreground`; updated in place.
        objects: found in it.
        scale: frame pixels per pixel of `mask`.
    """
    corners = np.rint((objects.boxes[objects.changes >= MOVES] + 0.5) / scale).astype(int)
    for left, top, right, bottom in np.maximum(corners, 0).tolist():
        inside = mask[top:bottom, left:right]
        inside[inside > MAX_BACKGROUND] = MOVING
