"""Merging of fragments into objects "under the guidance of the criterion function J_mn".

The paper leaves J_mn undefined. It is taken for the gap between two fragments.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, LabelImage


def clustered(cells: ByteImage, gap: int) -> tuple[LabelImage, int]:
    """The object of each cell, int32[h, w] from 1, undefined between cells; and the number of objects.

    The two nearest clusters are merged until no two have less than `gap` cells between them. Their distance
    is that of their nearest cells. The distance of their boxes would merge vehicles that drive side by side:
    the box around two of them overlaps a third.

    Args:
        cells: uint8[h, w], mask.
        gap: empty cells between two clusters that stay apart.

    Source: merging the nearest pair up to a distance is single linkage; its result is the connected
        components of all cells within that distance.
    """
    # Dilated by this, cells with less than `gap` between them touch.
    near = cv2.dilate(cells, np.ones((gap, gap), np.uint8)) if gap > 1 else cells
    count, labels = cv2.connectedComponents(near, connectivity=8)
    return cast("LabelImage", labels), count - 1
