"""Objects that stand close together, taken apart at full resolution.

The foreground at a coarser scale joins neighbours: halo, hysteresis and cells each bridge a pixel. At full
resolution the ground between them shows. What falls apart there may still be parts of one thing, such as the
hood and the roof of a car. Therefore only objects larger than most are taken apart, and only in traffic.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import Flags, FloatArray, LabelImage, above
from streamkit_differencer.measurement import PIXELS, measure_objects
from streamkit_differencer.objects import COLUMNS, NO_OBJECTS, Objects, chosen, measured
from streamkit_differencer.refinement import MAX_PX, FrameImages, clear_foreground

# With fewer objects in view none is typical: a rider near by and some specks are no traffic.
MIN_OBJECTS = 12
# A piece has at least this share of the typical area.
PIECE_SHARE = 0.25
# Ground shows between two pieces over this share of the object's size, and at least over this many px: less
# may be the line where a bright part meets a dark one.
GAP_SHARE, MIN_GAP_PX = 0.1, 2


def split_objects(objects: Objects, images: FrameImages) -> Objects:
    """The objects of a frame, with those taken apart between whose parts the ground shows."""
    if len(objects) < MIN_OBJECTS:
        return objects
    typical = typical_area(objects.areas)
    sizes = np.prod(objects.boxes[:, 2:] - objects.boxes[:, :2], axis=1)
    height, width = images.image.shape
    corners = np.clip(np.rint(objects.boxes + 0.5).astype(int), 0, (width, height, width, height))
    is_whole, found = np.ones(len(objects), np.bool_), []
    for number in np.flatnonzero(objects.areas > typical).tolist():
        gap = max(MIN_GAP_PX, round(GAP_SHARE * math.sqrt(objects.areas[number])))
        pieces = _pieces(images, corners[number].tolist(), gap, round(PIECE_SHARE * typical))
        if not len(pieces):
            continue
        # What lies in the box of a smaller object is part of that one.
        own = ~_are_within(pieces.boxes, objects.boxes[sizes < sizes[number]])
        if np.count_nonzero(own) > 1:
            is_whole[number] = False
            found.append(chosen(pieces, np.flatnonzero(own)))
    if not found:
        return objects
    parts = [chosen(objects, np.flatnonzero(is_whole)), *found]
    united = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    largest_first = np.argsort(-united["areas"], kind="stable")
    return chosen(Objects(**united, dropped=objects.dropped), largest_first)


def typical_area(areas: FloatArray) -> float:
    """The area of the object that half of the foreground is in smaller ones than, of areas float64[n].

    It weighs objects by their area: of the many specks that noise leaves none counts for much.
    """
    ordered = np.sort(areas)
    sums = np.cumsum(ordered)
    return float(ordered[np.searchsorted(sums, 0.5 * sums[-1])])


def _pieces(images: FrameImages, box: list[int], gap: int, min_area: int) -> Objects:
    """The parts of the foreground in a box, with `gap` px of ground between them; none of one that is whole.

    Args:
        images: the frame.
        box: first column and row, and those after the last; none has parts that is larger than `MAX_PX`.
        gap: px.
        min_area: of a part, px.
    """
    left, top, right, bottom = box
    if max(right - left, bottom - top) > MAX_PX:
        return NO_OBJECTS
    foreground = clear_foreground(*images, (top, bottom, left, right))
    clear = above(foreground, 0)
    near = cv2.dilate(clear, np.ones((gap, gap), np.uint8))
    count, labels = cv2.connectedComponents(near, connectivity=4)
    if count <= 2:  # the ground, and one part
        return NO_OBJECTS
    parts = cast("LabelImage", labels), count - 1
    table = measure_objects(foreground, clear, *parts, 0, 0, 1, max(min_area, 1))
    table = table[table[:, PIXELS] > 0.0]
    if len(table) < 2:
        return NO_OBJECTS
    found = measured(table, 1)
    corner = left, top
    return replace(found, centroids=found.centroids + corner, boxes=found.boxes + 2 * corner)


def _are_within(boxes: FloatArray, others: FloatArray) -> Flags:
    """bool[n], whether one of the others, float64[m, 4], contains each of the boxes, float64[n, 4]."""
    left, top, right, bottom = boxes.T[:, :, None]
    first, upper, last, lower = others.T[:, None, :]
    contains = (first <= left) & (upper <= top) & (right <= last) & (bottom <= lower)
    return np.asarray(contains.any(axis=1))
