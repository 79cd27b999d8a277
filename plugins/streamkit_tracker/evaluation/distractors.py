"""Leaves out tracks of what the truth of MOT Challenge calls a distractor: neither right nor wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streamkit_tracker.evaluation.boxes import overlaps
from streamkit_tracker.evaluation.identities import EPSILON, LEAST_OVERLAP, Labelled, best_pairs

# A person on a vehicle, one who never moves, a distractor, a reflection.
DISTRACTORS = (2, 7, 8, 12)


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
