"""Ghosts: foreground where an object was learnt as background and has moved away."""

from __future__ import annotations

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, Flags, LabelImage, local_range
from streamkit_differencer.equations import LONGEST_WAIT
from streamkit_differencer.filters.components import component_pixels

# Share of the outline that must be stronger in the background than in the frame, and by how much. An object
# that is just leaving its ghost hides a part of the ghost's outline.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75
# Frames without change of uncovered ground, in the same share of its pixels; leaves that blur what they cover
# move on.
REST_FRAMES = 6
# Outlines within two pixels of unknown background do not count.
BORDER_SQUARE = np.ones((5, 5), np.uint8)
_SQUARE = np.ones((3, 3), np.uint8)


def find_ghosts(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    waiting: ByteImage,
    mask: ByteImage,
    blocks: LabelImage,
    count: int,
) -> Flags:
    """The components of foreground at rest whose outline shows in the background and not in the frame.

    Args:
        image: uint8[h, w], f(t), as all images.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], not 0 where it is known.
        waiting: uint8[h, w], the counter D, see `equations.count_down`.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its components, see `components_of`.
        count: number of components.

    Returns:
        bool[count].

    Source: after Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges instead of optical flow.
    """
    rows, columns, component = component_pixels(mask, blocks)
    rest = np.bincount(component, waiting[rows, columns] <= LONGEST_WAIT - REST_FRAMES, count)
    rests = rest >= AGREEMENT * np.bincount(component, minlength=count)
    if not rests.any():
        return np.asarray(rests)
    is_outline = cv2.erode(mask, _SQUARE)[rows, columns] == 0
    rows, columns, component = rows[is_outline], columns[is_outline], component[is_outline]
    known = cv2.erode(valid, BORDER_SQUARE)[rows, columns] > 0
    edges = local_range(image)[rows, columns].astype(np.float64)
    shows = known & (local_range(background)[rows, columns] > RATIO * edges + LEAST_EDGE)
    known_length, votes = (np.bincount(component, which, count) for which in (known, shows))
    agrees = votes >= AGREEMENT * np.maximum(known_length, 1)
    return np.asarray(rests & agrees & (2 * known_length >= np.bincount(component, minlength=count)))
