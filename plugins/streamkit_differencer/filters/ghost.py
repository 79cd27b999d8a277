"""Ghosts: foreground where an object was learnt as background and has moved away."""

from __future__ import annotations

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, Flags, LabelImage, local_range
from streamkit_differencer.equations import LONGEST_WAIT
from streamkit_differencer.filters.components import pixels_of

# Share of the outline that must be stronger in the background than in the frame, and by how much. An object
# that is just leaving its ghost hides a part of the ghost's outline.
RATIO = 1.5
MIN_EDGE = 8.0
AGREEMENT = 0.75
# Frames without change of uncovered ground, in the same share of its pixels; leaves that blur what they cover
# move on.
REST_FRAMES = 6
# Unknown background within two pixels of an outline hides it.
_NEAR = np.ones((5, 5), np.uint8)


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
    rows, columns, numbers = pixels_of(blocks, mask)
    pixels = np.bincount(numbers, minlength=count)
    is_quiet = waiting[rows, columns] <= LONGEST_WAIT - REST_FRAMES
    rests = np.bincount(numbers, is_quiet, count) >= AGREEMENT * pixels
    if not rests.any():
        return np.asarray(rests)
    outline = cv2.erode(mask, np.ones((3, 3), np.uint8))[rows, columns] == 0
    known = outline & (cv2.erode(valid, _NEAR)[rows, columns] > 0)
    edges = RATIO * local_range(image)[rows, columns] + MIN_EDGE
    vanished = known & (local_range(background)[rows, columns] > edges)
    lengths, judged, votes = (np.bincount(numbers, chosen, count) for chosen in (outline, known, vanished))
    return np.asarray(rests & (votes >= AGREEMENT * np.maximum(judged, 1)) & (2 * judged >= lengths))
