"""Which targets of two runs over the same frames are one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import product

import numpy as np
import scipy

from streamkit.geometry.boxes import box_iou

SAME_IOU = 0.5  # the criterion of the MOT and PASCAL benchmarks

Boxes = dict[int, tuple[float, float, float, float]]


def match_ids(frames: Iterable[tuple[Boxes, Boxes]]) -> dict[int, int]:
    """Maps ids of a later run to those of an earlier one.

    A pair of targets counts the frames in which their boxes overlap by `SAME_IOU`; the pairs with the largest
    total are matched, if they overlap in most of the frames in which both are there.

    Args:
        frames: for each common frame, the boxes (x0, y0, x1, y1; px) by id in the earlier and the later run.

    Source: Ristani et al., Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking: the
        matching of identities that maximises IDTP.
    """
    agreed: Counter[tuple[int, int]] = Counter()
    common: Counter[tuple[int, int]] = Counter()
    for before, after in frames:
        if before and after:
            overlaps = box_iou(np.array(list(before.values())), np.array(list(after.values())))
            pairs = list(product(before, after))
            common.update(pairs)
            agreed.update(dict(zip(pairs, (overlaps.ravel() >= SAME_IOU).tolist(), strict=True)))
    rows = sorted({earlier for earlier, _ in agreed})
    columns = sorted({later for _, later in agreed})
    counts = np.array([[agreed[earlier, later] for later in columns] for earlier in rows])
    if not counts.size:
        return {}
    found = zip(*scipy.optimize.linear_sum_assignment(counts, maximize=True), strict=True)
    matched = [(rows[i], columns[j]) for i, j in found]
    return {
        later: earlier for earlier, later in matched if 2 * agreed[earlier, later] > common[earlier, later]
    }
