"""Higher order tracking accuracy (HOTA): detection and association weighed evenly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamkit_tracker.evaluation.boxes import IdArray, Labelled, best_pairs, overlaps
from streamkit_tracker.window_geometry import FloatArray

THRESHOLDS = np.arange(0.05, 0.99, 0.05)


@dataclass(frozen=True)
class HotaScores:
    """Means over the overlap thresholds 0.05, 0.10, ..., 0.95; each 0 to 1.

    Attributes:
        hota: geometric mean of detection and association accuracy.
        detection: share of true positives among all boxes of truth and tracks.
        association: how well the tracks of matched boxes agree with their truths over the whole sequence.
    """

    hota: float
    detection: float
    association: float


def score_hota(truth: Sequence[Labelled], tracks: Sequence[Labelled]) -> HotaScores:
    """Scores tracks, one `Labelled` for each frame of both.

    Source: Luiten et al., HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking, IJCV 129, 2021;
    matching and rounding as in TrackEval.
    """
    true_counts, true_rows = _numbered(truth)
    track_counts, track_rows = _numbered(tracks)
    similarities = [overlaps(true.boxes, tracked.boxes) for true, tracked in zip(truth, tracks, strict=True)]
    frames = list(zip(true_rows, track_rows, similarities, strict=True))
    count_sums = true_counts[:, None] + track_counts[None]
    alignment = _alignment(frames, count_sums)
    together = np.zeros((len(THRESHOLDS), *count_sums.shape))
    for rows, columns, similarity in frames:
        pairs = best_pairs(alignment[np.ix_(rows, columns)] * similarity)
        for row, column in pairs:
            together[similarity[row, column] >= THRESHOLDS - 1e-12, rows[row], columns[column]] += 1
    positives = together.sum(axis=(1, 2))
    found = positives / np.maximum(true_counts.sum() + track_counts.sum() - positives, 1)
    shared = together / np.maximum(count_sums - together, 1)
    associated = (together * shared).sum(axis=(1, 2)) / np.maximum(positives, 1)
    return HotaScores(
        float(np.mean(np.sqrt(found * associated))), float(np.mean(found)), float(np.mean(associated))
    )


def _alignment(frames: list[tuple[IdArray, IdArray, FloatArray]], count_sums: FloatArray) -> FloatArray:
    """How much two identities have in common over the whole sequence, 0 to 1: float64[truths, tracks]."""
    common = np.zeros_like(count_sums)
    for rows, columns, similarity in frames:
        union = similarity.sum(axis=0)[None] + similarity.sum(axis=1)[:, None] - similarity
        common[np.ix_(rows, columns)] += np.divide(
            similarity, union, out=np.zeros_like(similarity), where=union > 1e-12
        )
    return np.asarray(common / np.maximum(count_sums - common, 1e-12))


def _numbered(labelled: Sequence[Labelled]) -> tuple[FloatArray, list[IdArray]]:
    """The number of boxes of each identity, and the identities of each frame as numbers from 0."""
    no_ids = np.zeros(0, np.int64)
    known = np.unique(np.concatenate([no_ids, *(frame.ids for frame in labelled)]))
    rows = [np.searchsorted(known, frame.ids) for frame in labelled]
    return np.bincount(np.concatenate([no_ids, *rows]), minlength=len(known)).astype(np.float64), rows
