"""Scores of many targets with identities: CLEAR MOT and IDF1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from streamkit_tracker.evaluation.boxes import EPSILON, LEAST_OVERLAP, Labelled, best_pairs, overlaps

KEPT = 1000.0  # what a pair of the frame before outweighs


@dataclass(frozen=True)
class IdentityScores:
    """Scores over a sequence.

    Attributes:
        truths: boxes of the ground truth.
        misses: truths without a track.
        false_alarms: tracks without a truth.
        switches: truths whose track changed its id since they were last matched.
        identity_matches: matches under the best single pairing of ids over the whole sequence.
        tracked: boxes of the tracker.
        overlap: mean overlap of matched pairs.
    """

    truths: int
    misses: int
    false_alarms: int
    switches: int
    identity_matches: int
    tracked: int
    overlap: float

    @property
    def mota(self) -> float:
        """1 less the errors per truth; NaN without truth."""
        errors = self.misses + self.false_alarms + self.switches
        return 1 - errors / self.truths if self.truths else float("nan")

    @property
    def idf1(self) -> float:
        """Harmonic mean of identity precision and recall; NaN without boxes."""
        total = self.truths + self.tracked
        return 2 * self.identity_matches / total if total else float("nan")


@dataclass
class _Counts:
    """What is summed from frame to frame.

    `last` has the track that each truth was matched with last, `previous` the matches of the frame before.
    """

    misses: int = 0
    false_alarms: int = 0
    switches: int = 0
    overlap: float = 0.0
    matches: int = 0
    last: dict[int, int] = field(default_factory=dict)
    previous: dict[int, int] = field(default_factory=dict)
    together: dict[tuple[int, int], int] = field(default_factory=dict)


def score_identities(
    truth: Sequence[Labelled], tracks: Sequence[Labelled], least_overlap: float = LEAST_OVERLAP
) -> IdentityScores:
    """Scores tracks frame by frame.

    Args:
        truth: one for each frame.
        tracks: one for each frame, in the same order.
        least_overlap: from which a track and a truth may match, above 0.

    Raises:
        ValueError: the numbers of frames differ.

    Source: Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT
    Metrics, 2008, matched as in TrackEval; Ristani et al., Performance Measures and a Data Set for
    Multi-Target, Multi-Camera Tracking, 2016 (IDF1).
    """
    if len(truth) != len(tracks):
        raise ValueError(f"truth has {len(truth)} frames and the tracks have {len(tracks)}")
    counts = _Counts()
    for true, tracked in zip(truth, tracks, strict=True):
        _count_frame(counts, true, tracked, least_overlap)
    return IdentityScores(
        sum(len(true.ids) for true in truth),
        counts.misses,
        counts.false_alarms,
        counts.switches,
        _identity_matches(counts.together),
        sum(len(tracked.ids) for tracked in tracks),
        counts.overlap / max(counts.matches, 1),
    )


def _count_frame(counts: _Counts, true: Labelled, tracked: Labelled, least_overlap: float) -> None:
    overlap = overlaps(true.boxes, tracked.boxes)
    allowed = overlap >= least_overlap - EPSILON
    for row, column in np.argwhere(allowed):
        both = (int(true.ids[row]), int(tracked.ids[column]))
        counts.together[both] = counts.together.get(both, 0) + 1
    # A pair of the frame before is kept while it overlaps enough.
    followers = np.array([counts.previous.get(int(number), -1) for number in true.ids], np.int64)
    kept = followers[:, None] == tracked.ids[None]
    pairs = best_pairs(np.where(allowed, KEPT * kept + overlap, 0.0))
    counts.previous = {}
    for row, column in pairs:
        number, follower = int(true.ids[row]), int(tracked.ids[column])
        counts.switches += counts.last.get(number, follower) != follower
        counts.last[number] = counts.previous[number] = follower
        counts.overlap += float(overlap[row, column])
    counts.matches += len(pairs)
    counts.misses += len(true.ids) - len(pairs)
    counts.false_alarms += len(tracked.ids) - len(pairs)


def _identity_matches(together: dict[tuple[int, int], int]) -> int:
    """Most frames that any one-to-one pairing of true and tracked ids explains."""
    if not together:
        return 0
    true = {number: row for row, number in enumerate(sorted({t for t, _ in together}))}
    tracked = {number: column for column, number in enumerate(sorted({k for _, k in together}))}
    frames = np.zeros((len(true), len(tracked)))
    for (number, follower), count in together.items():
        frames[true[number], tracked[follower]] = count
    return int(sum(frames[pair] for pair in best_pairs(frames)))
