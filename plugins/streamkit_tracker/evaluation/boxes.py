"""Boxes of a frame with their identities: overlaps, the best pairs, and which tracks count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from streamkit_tracker.window_geometry import FloatArray

IdArray = NDArray[np.int64]

LEAST_OVERLAP = 0.5
EPSILON = 1e-12
# A person on a vehicle, one who never moves, a distractor, a reflection.
DISTRACTORS = (2, 7, 8, 12)


@dataclass(frozen=True, eq=False)
class Labelled:
    """The targets of one frame.

    Attributes:
        ids: int64[n].
        boxes: float64[n, 4], left, top, width, height, px.
    """

    ids: IdArray
    boxes: FloatArray


def overlaps(first: FloatArray, second: FloatArray) -> FloatArray:
    """Intersection over union of every pair.

    Args:
        first: float64[n, 4], left, top, width, height, px.
        second: float64[m, 4], likewise.

    Returns:
        float64[n, m], 0 to 1; boxes without area overlap nothing.
    """
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, :2] + first[:, None, 2:], second[None, :, :2] + second[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(np.maximum(boxes[:, 2:], 0.0), axis=1) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None] - common
    return np.asarray(np.where(union > 0, common / np.maximum(union, 1e-12), 0.0))


def best_pairs(scores: FloatArray) -> list[tuple[int, int]]:
    """The pairs (row, column) of the greatest total score, without those that score nothing."""
    rows, columns = scipy.optimize.linear_sum_assignment(scores, maximize=True)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [pair for pair in pairs if scores[pair] > EPSILON]


def without_distractors(tracks: Sequence[Labelled], classes: Sequence[Labelled]) -> list[Labelled]:
    """The tracks of each frame without those whose best match is a distractor.

    Args:
        tracks: one for each frame.
        classes: every box of the truth with its class in place of an id, one for each frame.

    Source: Milan et al., MOT16: A Benchmark for Multi-Object Tracking, 2016, section 4.1; as in TrackEval.
    """
    kept = []
    for tracked, truth in zip(tracks, classes, strict=True):
        overlap = overlaps(truth.boxes, tracked.boxes)
        pairs = best_pairs(np.where(overlap >= LEAST_OVERLAP - EPSILON, overlap, 0.0))
        is_kept = np.ones(len(tracked.ids), np.bool_)
        is_kept[[column for row, column in pairs if truth.ids[row] in DISTRACTORS]] = False
        kept.append(Labelled(tracked.ids[is_kept], tracked.boxes[is_kept]))
    return kept
