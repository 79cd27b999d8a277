"""Pieces of the foreground that hang together, for filters that judge each as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.resampling import parts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    IntArray = NDArray[np.intp]
    BoolArray = NDArray[np.bool_]
    LabelImage = NDArray[np.int32]
    Region = tuple[slice, slice]

# Of larger foreground a share of the pixels is asked.
MOST_POINTS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Connected pieces of a mask; those with a pixel or less between them may be one.

    They are told apart at half resolution, which costs a quarter.

    Attributes:
        mask: uint8[h, w].
        parts: rectangles that hold all of the mask.
        half: uint8[h // 2, w // 2], mask of the squares of two by two that have something in them.
        labels: int32[h // 2, w // 2], from 1; 0 is none.
        count: of the labels, with 0.
    """

    mask: ByteImage
    parts: list[Region]
    half: ByteImage
    labels: LabelImage
    count: int

    @classmethod
    def of(cls, mask: ByteImage, where: list[Region] | None = None) -> Pieces:
        """The pieces of a mask, uint8[h, w] with h and w at least 2; `where` are its parts if known."""
        height, width = mask.shape[0] // 2, mask.shape[1] // 2
        half = cv2.resize(mask[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
        cv2.threshold(half, 0, 255, cv2.THRESH_BINARY, dst=half)
        count, labels = cv2.connectedComponents(half, connectivity=8)
        where = parts(mask) if where is None else where
        return cls(mask, where, cast("ByteImage", half), cast("LabelImage", labels), count)

    def owners(self, rows: IntArray, columns: IntArray) -> LabelImage:
        """The piece that each pixel belongs to, int32[n]."""
        height, width = self.labels.shape
        return np.asarray(self.labels[np.minimum(rows // 2, height - 1), np.minimum(columns // 2, width - 1)])

    def points(self) -> tuple[IntArray, IntArray, LabelImage]:
        """A pixel in each square of two by two that has one: rows, columns and pieces, each int[n]."""
        if self.count == 1:
            return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0, np.int32)
        rows, columns = points_of(self.half)
        rows, columns = 2 * rows, 2 * columns
        # The other corner where this one is not in the mask; what has neither has a neighbour.
        other = self.mask[rows, columns] == 0
        rows, columns = rows + other, columns + other
        inside = self.mask[rows, columns] > 0
        rows, columns = rows[inside], columns[inside]
        return rows, columns, self.labels[rows // 2, columns // 2]

    def only(self, chosen: BoolArray) -> ByteImage:
        """The mask of some pieces; bool[count] says which."""
        result = np.zeros_like(self.mask)
        value = np.where(chosen, np.uint8(255), np.uint8(0))
        for rows, columns in self.parts:
            half = np.s_[rows.start // 2 : -(-rows.stop // 2), columns.start // 2 : -(-columns.stop // 2)]
            picked = value[self.labels[half]]
            if not picked.size:
                continue
            size = 2 * picked.shape[1], 2 * picked.shape[0]
            whole = np.s_[2 * half[0].start :, 2 * half[1].start :]
            inner = result[whole][: size[1], : size[0]]
            cv2.resize(picked, size, dst=inner, interpolation=cv2.INTER_NEAREST)
            cv2.bitwise_and(inner, self.mask[whole][: size[1], : size[0]], dst=inner)
        return result


def points_of(mask: ByteImage) -> tuple[IntArray, IntArray]:
    """Rows and columns of the pixels of a mask, intp[n]; of many every so-manieth."""
    points = np.flatnonzero(mask != 0)
    rows, columns = np.divmod(points[thinned(len(points))], mask.shape[1])
    return rows, columns


def thinned(count: int) -> slice:
    """Which of `count` pixels are asked: of many every so-manieth."""
    return np.s_[:: max(1, -(-count // MOST_POINTS))]
