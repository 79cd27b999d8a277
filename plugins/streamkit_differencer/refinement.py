"""Boxes and centroids refined at full resolution, in the small piece of the frame where an object was found.

Foreground takes in whatever differs from the ground by some deviations of its noise: also the pixels around a
thing that it covers by a tenth. Its edge lies where about half of its contrast is reached.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from streamkit_differencer.objects import LOWEST_MARK, Objects

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatArray = NDArray[np.float64]

# A thing's edge lies where this share of its mean contrast is reached; pixels around it lower that mean.
EDGE_SHARE = 0.4
# What would shrink to less than this share of its area has parts as grey as the ground, and is left as it is.
LEAST_AREA = 0.35
# Larger things gain nothing.
LARGEST_PX = 256


def refined(
    objects: Objects, image: ByteImage, ground: ByteImage, to_ground: FloatArray, mask: ByteImage, scale: int
) -> Objects:
    """The objects with boxes, centroids and areas measured on the frame itself.

    One whose box overlaps another's is left as it is, and so is one that hardly differs from the ground.

    Args:
        objects: as measured on the foreground.
        image: uint8[h, w], the frame at full resolution.
        ground: uint8[h, w], the background.
        to_ground: float64[3, 3], pixels of the frame to those of `ground`.
        mask: uint8[h, w], the frame's foreground at the working scale.
        scale: frame pixels per working pixel.
    """
    boxes, centroids, areas = objects.boxes.copy(), objects.centroids.copy(), objects.areas.copy()
    corners = np.rint(boxes + 0.5).astype(int).tolist()
    for number in np.flatnonzero(alone(boxes)):
        left, top, right, bottom = corners[number]
        right, bottom = min(right, image.shape[1]), min(bottom, image.shape[0])
        if not 0 < max(right - left, bottom - top) <= LARGEST_PX:
            continue
        found = mask[top // scale : -(-bottom // scale), left // scale : -(-right // scale)]
        shifted = to_ground.copy()
        shifted[:, 2] += left * to_ground[:, 0] + top * to_ground[:, 1]
        measured = measured_at(image[top:bottom, left:right], ground, shifted, found, scale)
        if measured is not None:
            boxes[number] = np.add(measured[0], (left, top, left, top)) - 0.5
            centroids[number] = left + measured[1][0], top + measured[1][1]
            areas[number] = measured[2]
    return replace(objects, boxes=boxes, centroids=centroids, areas=areas)


def alone(boxes: FloatArray) -> NDArray[np.bool_]:
    """Which boxes overlap no other, bool[n]: in the others the foreground may be another's."""
    meets = (boxes[:, None, :2] < boxes[None, :, 2:]).all(axis=2)
    return np.asarray((meets & meets.T).sum(axis=1) == 1)


def measured_at(
    piece: ByteImage, ground: ByteImage, to_ground: FloatArray, found: ByteImage, scale: int
) -> tuple[tuple[int, int, int, int], tuple[float, float], float] | None:
    """Where the thing in a piece of the frame is, in pixels of the piece.

    Args:
        piece: uint8[h, w].
        ground: uint8, the background.
        to_ground: float64[3, 3], pixels of the piece to those of `ground`.
        found: uint8[h / scale, w / scale], foreground.
        scale: pixels of the piece per pixel of `found`.

    Returns:
        Outer edges x0 y0 x1 y1; the centroid, x y; and the area, px. None where the contrast does not tell.
    """
    size = piece.shape[1], piece.shape[0]
    warp = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    difference = cv2.warpPerspective(ground, to_ground, size, flags=warp, borderMode=cv2.BORDER_REPLICATE)
    cv2.absdiff(difference, piece, dst=difference)
    where = cv2.threshold(found, LOWEST_MARK, 255, cv2.THRESH_BINARY)[1]
    if scale > 1:
        where = cv2.resize(where, size, interpolation=cv2.INTER_NEAREST)
    edge = EDGE_SHARE * cv2.mean(difference, where)[0]
    thing = cv2.bitwise_and(cv2.threshold(difference, edge, 255, cv2.THRESH_BINARY)[1], where)
    moments = cv2.moments(thing, binaryImage=True)
    area = moments["m00"]
    if area < LEAST_AREA * cv2.countNonZero(where) or not area:
        return None
    left, top, width, height = cv2.boundingRect(thing)
    box = left, top, left + width, top + height
    return box, (moments["m10"] / area, moments["m01"] / area), area
