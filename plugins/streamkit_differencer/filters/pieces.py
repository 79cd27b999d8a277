"""Pieces of the foreground that hang together, for filters that judge each as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    IntArray = NDArray[np.intp]
    BoolArray = NDArray[np.bool_]
    LabelImage = NDArray[np.int32]

# Of larger foreground a share of the pixels is asked.
MOST_POINTS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Connected pieces of a mask; those with a pixel or less between them may be one.

    They are told apart at half resolution, which costs a quarter.

    Attributes:
        mask: uint8[h, w].
        labels: int32[h // 2, w // 2], from 1; 0 is none.
        count: of the labels, with 0.
    """

    mask: ByteImage
    labels: LabelImage
    count: int

    @classmethod
    def of(cls, mask: ByteImage) -> Pieces:
        """The pieces of a mask, uint8[h, w] with h and w at least 2."""
        height, width = mask.shape[0] // 2, mask.shape[1] // 2
        half = cv2.resize(mask[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
        cv2.threshold(half, 0, 255, cv2.THRESH_BINARY, dst=half)
        count, labels = cv2.connectedComponents(half, connectivity=8)
        return cls(mask, cast("LabelImage", labels), count)

    def owners(self, rows: IntArray, columns: IntArray) -> LabelImage:
        """The piece that each pixel belongs to, int32[n]."""
        height, width = self.labels.shape
        return np.asarray(self.labels[np.minimum(rows // 2, height - 1), np.minimum(columns // 2, width - 1)])

    def points(self) -> tuple[IntArray, IntArray, LabelImage]:
        """A pixel in each square of two by two that has one: rows, columns and pieces, each int[n]."""
        if self.count == 1:
            return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0, np.int32)
        half = cv2.findNonZero(np.minimum(self.labels, 1).astype(np.uint8)).reshape(-1, 2)
        half = half[:: -(-len(half) // MOST_POINTS)].astype(np.intp)
        columns, rows = 2 * half.T
        # The other corner where this one is not in the mask; what has neither has a neighbour.
        other = self.mask[rows, columns] == 0
        rows, columns = rows + other, columns + other
        inside = self.mask[rows, columns] > 0
        rows, columns = rows[inside], columns[inside]
        return rows, columns, self.labels[rows // 2, columns // 2]

    def only(self, chosen: BoolArray) -> ByteImage:
        """The mask of some pieces; bool[count] says which."""
        half = np.where(chosen, np.uint8(255), np.uint8(0))[self.labels]
        result = np.zeros_like(self.mask)
        height, width = half.shape
        inner = result[: 2 * height, : 2 * width]
        inner[:] = cv2.resize(half, (2 * width, 2 * height), interpolation=cv2.INTER_NEAREST)
        cv2.bitwise_and(result, self.mask, dst=result)
        return result


def points_of(mask: ByteImage) -> tuple[IntArray, IntArray]:
    """Rows and columns of the pixels of a mask, intp[n]; of many every so-manieth."""
    if not cv2.countNonZero(mask):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    points = cv2.findNonZero(mask).reshape(-1, 2)
    points = points[:: -(-len(points) // MOST_POINTS)]
    return points[:, 1].astype(np.intp), points[:, 0].astype(np.intp)
