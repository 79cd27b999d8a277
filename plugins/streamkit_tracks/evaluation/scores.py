"""Scores of boxes with identities: CLEAR MOT, IDF1 and HOTA of many targets, one-pass evaluation of one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from streamkit.geometry.boxes import box_iou
from streamkit.geometry.homography import FloatArray

IdArray = NDArray[np.int64]

MIN_OVERLAP = 0.5
EPSILON = 1e-12
KEPT = 1000.0  # score of a pair of the frame before: more than all overlaps of a frame
HOTA_THRESHOLDS = np.arange(0.05, 0.99, 0.05)
SUCCESS_THRESHOLDS = np.linspace(0.0, 1.0, 21)
PRECISE_WITHIN = 20.0  # px
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
    """Intersection over union of every pair of boxes float64[n, 4] and float64[m, 4]: float64[n, m], 0 to 1.

    Boxes are left, top, width, height, px; those without area overlap nothing.
    """
    return box_iou(*(np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]]) for boxes in (first, second)))


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
        pairs = best_pairs(np.where(overlap >= MIN_OVERLAP - EPSILON, overlap, 0.0))
        is_kept = np.ones(len(tracked.ids), np.bool_)
        is_kept[[column for row, column in pairs if truth.ids[row] in DISTRACTORS]] = False
        kept.append(Labelled(tracked.ids[is_kept], tracked.boxes[is_kept]))
    return kept


@dataclass(frozen=True)
class IdentityScores:
    """CLEAR MOT and IDF1 over a sequence.

    Attributes:
        mota: 1 less the errors per truth; NaN without truth.
        idf1: harmonic mean of identity precision and recall, under the best single pairing of ids over the
            whole sequence; NaN without boxes.
        switches: truths whose track changed its id since they were last matched.
        misses: truths without a track.
        false_alarms: tracks without a truth.
        truths: boxes of the ground truth.
        overlap: mean overlap of matched pairs.
    """

    mota: float
    idf1: float
    switches: int
    misses: int
    false_alarms: int
    truths: int
    overlap: float


def score_identities(
    truth: Sequence[Labelled], tracks: Sequence[Labelled], min_overlap: float = MIN_OVERLAP
) -> IdentityScores:
    """Scores tracks frame by frame.

    Args:
        truth: one for each frame.
        tracks: one for each frame, in the same order.
        min_overlap: from which a track and a truth may match, above 0.

    Raises:
        ValueError: the numbers of frames differ.

    Source: Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT
    Metrics, 2008, matched as in TrackEval; Ristani et al., Performance Measures and a Data Set for
    Multi-Target, Multi-Camera Tracking, 2016 (IDF1).
    """
    if len(truth) != len(tracks):
        raise ValueError(f"truth has {len(truth)} frames and the tracks have {len(tracks)}")
    last: dict[int, int] = {}  # the track that each truth was matched with last
    previous: dict[int, int] = {}  # matches of the frame before
    together: Counter[tuple[int, int]] = Counter()
    switches, matched_overlaps = 0, [0.0]
    for true, tracked in zip(truth, tracks, strict=True):
        similarity = overlaps(true.boxes, tracked.boxes)
        allowed = similarity >= min_overlap - EPSILON
        true_ids, ids = true.ids.tolist(), tracked.ids.tolist()
        together.update((true_ids[row], ids[column]) for row, column in np.argwhere(allowed).tolist())
        # A pair of the frame before is kept while it overlaps enough.
        followers = np.array([previous.get(number, -1) for number in true_ids], np.int64)
        kept = followers[:, None] == tracked.ids
        pairs = best_pairs(np.where(allowed, KEPT * kept + similarity, 0.0))
        previous = {true_ids[row]: ids[column] for row, column in pairs}
        switches += sum(last.get(number, follower) != follower for number, follower in previous.items())
        last |= previous
        matched_overlaps += [float(similarity[pair]) for pair in pairs]
    matches = len(matched_overlaps) - 1
    truths, found = (sum(len(frame.ids) for frame in frames) for frames in (truth, tracks))
    misses, false_alarms = truths - matches, found - matches
    mota = 1 - (misses + false_alarms + switches) / truths if truths else float("nan")
    idf1 = 2 * _identity_matches(together) / (truths + found) if truths + found else float("nan")
    overlap = sum(matched_overlaps) / max(matches, 1)
    return IdentityScores(mota, idf1, switches, misses, false_alarms, truths, overlap)


def _identity_matches(together: Counter[tuple[int, int]]) -> int:
    """Most frames that any one-to-one pairing of true and tracked ids explains."""
    if not together:
        return 0
    true, tracked = np.array(list(together)).T
    true_ids, rows = np.unique(true, return_inverse=True)
    track_ids, columns = np.unique(tracked, return_inverse=True)
    frames = np.zeros((len(true_ids), len(track_ids)))
    frames[rows, columns] = list(together.values())
    return int(sum(frames[pair] for pair in best_pairs(frames)))


@dataclass(frozen=True)
class HotaScores:
    """Means over the overlap thresholds 0.05, 0.10, ..., 0.95; each 0 to 1.

    Attributes:
        hota: geometric mean of detection and association accuracy.
        detection_accuracy: share of true positives among all boxes of truth and tracks.
        association_accuracy: how well the tracks of matched boxes agree with their truths over the whole
            sequence.
    """

    hota: float
    detection_accuracy: float
    association_accuracy: float


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
    common = np.zeros_like(count_sums)  # how much two identities share over the whole sequence
    for rows, columns, similarity in frames:
        union = similarity.sum(axis=0)[None] + similarity.sum(axis=1)[:, None] - similarity
        common[np.ix_(rows, columns)] += np.where(union > EPSILON, similarity / np.maximum(union, EPSILON), 0)
    alignment = common / np.maximum(count_sums - common, EPSILON)
    together = np.zeros((len(HOTA_THRESHOLDS), *count_sums.shape))
    for rows, columns, similarity in frames:
        for row, column in best_pairs(alignment[np.ix_(rows, columns)] * similarity):
            is_found = similarity[row, column] >= HOTA_THRESHOLDS - EPSILON
            together[is_found, rows[row], columns[column]] += 1
    positives = together.sum(axis=(1, 2))
    found = positives / np.maximum(true_counts.sum() + track_counts.sum() - positives, 1)
    shared = together / np.maximum(count_sums - together, 1)
    associated = (together * shared).sum(axis=(1, 2)) / np.maximum(positives, 1)
    hota = float(np.mean(np.sqrt(found * associated)))
    return HotaScores(hota, float(np.mean(found)), float(np.mean(associated)))


def _numbered(labelled: Sequence[Labelled]) -> tuple[FloatArray, list[IdArray]]:
    """The number of boxes of each identity, and the identities of each frame as numbers from 0."""
    no_ids = np.zeros(0, np.int64)
    known = np.unique(np.concatenate([no_ids, *(frame.ids for frame in labelled)]))
    rows = [np.searchsorted(known, frame.ids) for frame in labelled]
    return np.bincount(np.concatenate([no_ids, *rows]), minlength=len(known)).astype(np.float64), rows


@dataclass(frozen=True)
class OnePassScores:
    """Scores of one target over the frames that have a truth.

    Attributes:
        success: mean over 21 thresholds of the share of frames that overlap by more, 0 to 1.
        precision: share of frames with a centre error of at most 20 px.
        centre_error: median centre error, px; infinite where most frames have no box.
        frames: number of frames scored.
    """

    success: float
    precision: float
    centre_error: float
    frames: int


def one_pass(found: FloatArray, truth: FloatArray) -> OnePassScores:
    """Scores one target followed from its first box.

    Args:
        found: float64[n, 4], left, top, width, height, px; NaN where the tracker gave no box.
        truth: float64[n, 4], likewise; NaN or no area where there is no truth.

    Raises:
        ValueError: the lengths differ, or no frame has a truth.

    Source: Wu, Lim and Yang, Online Object Tracking: A Benchmark, CVPR 2013.
    """
    if found.shape != truth.shape:
        raise ValueError(f"one box for each truth is needed, got {len(found)} boxes for {len(truth)}")
    scored = np.isfinite(truth).all(axis=1) & (truth[:, 2:] > 0).all(axis=1)
    if not scored.any():
        raise ValueError("no frame has a truth to score against")
    found, truth = found[scored], truth[scored]
    missing = ~np.isfinite(found).all(axis=1)
    pairs = zip(np.nan_to_num(found), truth, strict=True)
    overlap = np.array([overlaps(box[None], true[None])[0, 0] for box, true in pairs])
    error = np.hypot(*(found[:, :2] + found[:, 2:] / 2 - truth[:, :2] - truth[:, 2:] / 2).T)
    overlap[missing], error[missing] = 0.0, np.inf
    success = float(np.mean(overlap > SUCCESS_THRESHOLDS[:, None]))
    return OnePassScores(
        success, float(np.mean(error <= PRECISE_WITHIN)), float(np.median(error)), len(truth)
    )
