"""Pieces of the foreground that hang together, for filters that judge each as a whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamkit_differencer.canvas_region import REGION
from streamkit_kernels import BLOCKS, BYTES, FLAGS, FLOATS, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    ByteLine = NDArray[np.uint8]
    Flags = NDArray[np.bool_]
    Blocks = NDArray[np.int32]
    Labels = NDArray[np.int32]

# Of larger foreground a share of the pixels is asked.
MOST_POINTS = 1000


@kernel(BYTES, REGION)
def pieces_of(mask: ByteImage, region: Region) -> tuple[Blocks, int]:
    """Connected pieces of a mask; those with a pixel or less between them may be one.

    They are told apart by blocks of two by two pixels; an odd last line or column is left out.

    Args:
        mask: uint8[h, w].
        region: of the mask, what is looked at.

    Returns:
        int32[n, 3], of each block that has something in it the line and the column of its first pixel, and
        its piece, from 0; and how many pieces there are.
    """
    top, bottom, left, right = region
    count = (right - left) // 2
    filled = np.zeros((max((bottom - top) // 2, 0), max(count, 0)), np.uint8)
    total = 0
    for line in range(len(filled)):
        first, second = mask[top + 2 * line, left:right], mask[top + 2 * line + 1, left:right]
        if _has_something(first) or _has_something(second):
            total += _blocks(first, second, filled[line])
    blocks = np.empty((total, 3), np.int32)
    # Labels of the line before and of this one, with an empty one at each end.
    before, labels = np.zeros(count + 2, np.int32), np.zeros(count + 2, np.int32)
    parents = np.empty(total + 1, np.int32)
    for index in range(total + 1):
        parents[index] = index
    found = used = 0
    for line in range(len(filled)):
        if not _has_something(filled[line]):
            for column in range(count + 2):
                before[column] = 0
            continue
        for column in range(count):
            label = 0
            if filled[line, column] > 0:
                for other in (labels[column], before[column], before[column + 1], before[column + 2]):
                    if other > 0:
                        label = _joined(parents, label, other) if label > 0 else _root(parents, other)
                if label == 0:
                    used += 1
                    label = used
                blocks[found, 0], blocks[found, 1] = top + 2 * line, left + 2 * column
                blocks[found, 2] = label
                found += 1
            labels[column + 1] = label
        before, labels = labels, before
    return blocks, _numbered(blocks, parents, used)


@compiled
def _has_something(line: ByteLine) -> bool:
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def _blocks(first: ByteLine, second: ByteLine, filled: ByteLine) -> int:
    """Which blocks of two lines have something in them, and how many do."""
    total = np.int32(0)
    for index in range(filled.size):
        both = first[2 * index] | first[2 * index + 1] | second[2 * index] | second[2 * index + 1]
        filled[index] = both
        total += np.int32(both > 0)
    return int(total)


@compiled
def _root(parents: Labels, label: int) -> int:
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@compiled
def _joined(parents: Labels, first: int, second: int) -> int:
    """Makes one piece of two, under the smaller label."""
    one, other = _root(parents, first), _root(parents, second)
    parents[max(one, other)] = min(one, other)
    return min(one, other)


@compiled
def _numbered(blocks: Blocks, parents: Labels, used: int) -> int:
    """Gives the pieces numbers without gaps; how many they are."""
    numbers = np.zeros(used + 1, np.int32)
    count = 0
    for index in range(len(blocks)):
        root = _root(parents, blocks[index, 2])
        if numbers[root] == 0:
            count += 1
            numbers[root] = count
        blocks[index, 2] = numbers[root] - 1
    return count


@kernel(BLOCKS, FLAGS, FLAGS, BYTES, BYTES, BYTES, FLOATS)
def take_away(
    blocks: Blocks,
    ghosts: Flags,
    slides: Flags,
    mask: ByteImage,
    quiet: ByteImage,
    image: ByteImage,
    background: FloatImage,
) -> None:
    """Takes pieces away from the foreground, and learns them as ground.

    Args:
        blocks: int32[n, 3], see `pieces_of`.
        ghosts: bool[pieces], those that are learnt at once.
        slides: bool[pieces], those that are learnt where they are quiet: edges are learnt as soon as they
            stand still, or the background would fall behind.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        image: uint8[h, w], f(t).
        background: float32[h, w], B.
    """
    for index in range(len(blocks)):
        piece = blocks[index, 2]
        if not (ghosts[piece] or slides[piece]):
            continue
        for row in range(blocks[index, 0], blocks[index, 0] + 2):
            for column in range(blocks[index, 1], blocks[index, 1] + 2):
                if mask[row, column] > 0:
                    mask[row, column] = 0
                    if ghosts[piece] or quiet[row, column] > 0:
                        background[row, column] = image[row, column]
