"""Connected components of the foreground, for filters that classify each as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, Flags, FloatImage, LabelImage, Region
from streamkit_differencer.lines import is_any_set
from streamkit_kernels import BLOCKS, BYTES, FLAGS, FLOATS, compiled, kernel

Labels = NDArray[np.int32]

# Larger components are sampled.
MOST_POINTS = 1000


@kernel(BYTES, REGION)
def components_of(mask: ByteImage, region: Region) -> tuple[LabelImage, int]:
    """Connected components of a mask, of blocks of two by two pixels; an odd last row or column is left out.

    Args:
        mask: uint8[h, w].
        region: of the mask.

    Returns:
        int32[n, 3], of each set block the row and the column of its first pixel, and its component, from 0;
        and the number of components.
    """
    top, bottom, left, right = region
    count = (right - left) // 2
    filled = np.zeros((max((bottom - top) // 2, 0), max(count, 0)), np.uint8)
    total = 0
    for line in range(len(filled)):
        first, second = mask[top + 2 * line, left:right], mask[top + 2 * line + 1, left:right]
        if is_any_set(first) or is_any_set(second):
            total += _blocks(first, second, filled[line])
    blocks = np.empty((total, 3), np.int32)
    # Labels of the previous and of this line of blocks, with an empty one at each end.
    before, labels = np.zeros(count + 2, np.int32), np.zeros(count + 2, np.int32)
    parents = np.empty(total + 1, np.int32)
    for index in range(total + 1):
        parents[index] = index
    found = used = 0
    for line in range(len(filled)):
        if not is_any_set(filled[line]):
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
def _blocks(first: ByteLine, second: ByteLine, filled: ByteLine) -> int:
    """Sets the blocks of two rows in which a pixel is set; returns their number."""
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
    """Joins two components under the smaller label."""
    one, other = _root(parents, first), _root(parents, second)
    parents[max(one, other)] = min(one, other)
    return min(one, other)


@compiled
def _numbered(blocks: LabelImage, parents: Labels, used: int) -> int:
    """Numbers the components without gaps; returns their number."""
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
def remove_components(
    blocks: LabelImage,
    ghosts: Flags,
    shifted: Flags,
    mask: ByteImage,
    quiet: ByteImage,
    image: ByteImage,
    background: FloatImage,
) -> None:
    """Removes components from the foreground, and learns them as background.

    Args:
        blocks: int32[n, 3], see `components_of`.
        ghosts: bool[components], those to learn at once.
        shifted: bool[components], those to learn where they are quiet, so that the background keeps up.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        image: uint8[h, w], f(t).
        background: float32[h, w], B.
    """
    for index in range(len(blocks)):
        component = blocks[index, 2]
        if not (ghosts[component] or shifted[component]):
            continue
        for row in range(blocks[index, 0], blocks[index, 0] + 2):
            for column in range(blocks[index, 1], blocks[index, 1] + 2):
                if mask[row, column] > 0:
                    mask[row, column] = 0
                    if ghosts[component] or quiet[row, column] > 0:
                        background[row, column] = image[row, column]
