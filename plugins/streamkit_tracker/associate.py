"""Gated global nearest neighbour: detections go to the targets at the least total cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from streamkit_kernels import compiled, product
from streamkit_tracker.appearance.feature_template import unit_rows
from streamkit_tracker.appearance.mean_features import MeanFeatures
from streamkit_tracker.delete import position_doubt
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import (
    SETTLED_S,
    TENTATIVE,
    BoolArray,
    IndexArray,
    TargetModel,
    TargetRows,
    TargetTable,
    centroid_std,
)
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, IntArray

GATE = 16.0  # squared standard deviations: of the true detections 0.03 % lie beyond (chi squared)
# Overlap beyond the gate; cost that any pair within it is below; one that no pair has.
MIN_OVERLAP, LAST_CHOICE, FORBIDDEN = 0.15, 100.0, 1e6
MIN_SIZE = 4.0  # px: sides of smaller regions differ by more than their size
TOUCHING = 0.05  # of the smaller box: less is the noise of their edges
# Part of a difference in size by which the centre is off; a half where one edge belongs to another target.
MISMATCH_STD, CROWDED_MISMATCH_STD = 0.12, 0.5
FEATURE_WEIGHT = 2.0
FEATURE_RATE, OBJECT_FEATURE_RATE = 0.2, 0.05  # per detection; what covers an object is not to be learnt
ALIKE = 0.5  # difference of the sides, relative
KNOWN_TO = 1.0  # sides; a gate that is wider says nothing about a position
SHARED_OVERLAP = 0.75  # from which a region shows one target alone, and part of a target that lies in it
OBJECT_OVERLAP = 0.3  # of an object and its predicted box, as in SORT (Bewley et al., 2016)
SCORE_RATE, WEAK_SHARE = 0.02, 0.5  # per frame; of the usual score
X, Y, LEFT, TOP, RIGHT, BOTTOM = range(6)  # of a detection


class Comparison(NamedTuple):
    """Comparison of t targets with d detections.

    Attributes:
        costs: float64[t, d], infinite for pairs that are not allowed.
        distances: float64[t, d], squared, of the centroids from the targets, standard deviations.
        mismatch: float64[t, d], difference of the boxes' sizes, px.
        touched: int64[d], targets with a part of themselves in the box.
    """

    costs: FloatArray
    distances: FloatArray
    mismatch: FloatArray
    touched: IntArray


def associate(table: TargetTable, detected: FloatArray, observation: Observation) -> IndexArray:
    """Assigns detections to followed targets, then to dormant ones, and what is left to tentative ones.

    Of a detector's objects, the weak ones are second choice, wake no target, and start none: they are often a
    part of a person, or two at once.

    Args:
        table: predicted for this frame; the fields of its detections are filled.
        detected: float64[d, 6], centroids x, y and boxes x0 y0 x1 y1, px.
        observation: of this frame.

    Returns:
        Rows of the usable detections that no target was given and that may start one.

    Source: Zhang et al., ByteTrack: Multi-Object Tracking by Associating Every Detection Box, 2022.
    """
    followed, dormant = table.followed, table.dormant
    usable = np.isfinite(detected).all(axis=1) & (detected[:, 4:] > detected[:, 2:4]).all(axis=1)
    is_weak = np.zeros(len(detected), np.bool_)
    if observation.are_objects and observation.scores is not None:
        is_weak = find_weak(table, observation.scores)
    strong, weak = np.flatnonzero(usable & ~is_weak), np.flatnonzero(usable & is_weak)
    unlike, costs = _compare_features(table.models, observation)
    # a dormant target of unknown position is found upon its prediction only
    is_gated = ~dormant | (position_doubt(table.rows) < KNOWN_TO)
    strong = assign(table, followed & ~dormant, strong, detected, costs, is_gated)
    large = np.flatnonzero(followed & ~dormant & table.rows["whole"] & (table.rows["credit_s"] >= SETTLED_S))
    if len(large) > 1 and not observation.are_objects:
        strong = share_regions(table.rows, large, strong, detected)
    assign(table, followed & ~dormant, weak, detected, costs, is_gated)
    for group in (followed & dormant, ~followed):
        strong = assign(table, group, strong, detected, costs, is_gated)
    _learn_features(table, unlike, observation)
    return strong


def find_weak(table: TargetTable, scores: FloatArray) -> BoolArray:
    """Which objects score less than half of what is usual, bool[d]; the usual score learns float64[d].

    Detectors differ in their scales. The usual score is a mean in which each counts by itself: the many faint
    boxes of a detector with a low threshold hardly lower it.
    """
    scores = np.clip(np.nan_to_num(scores, nan=1.0), 0.0, 1.0)
    table.score_sums = (1 - SCORE_RATE) * table.score_sums + [scores.sum(), (scores**2).sum()]
    total, squares = table.score_sums
    return np.asarray(scores * total < WEAK_SHARE * squares)


def assign(
    table: TargetTable,
    group: BoolArray,
    free: IndexArray,
    detected: FloatArray,
    feature_costs: FloatArray,
    is_gated: BoolArray,
) -> IndexArray:
    """Assigns detections to the targets of a group that have none yet, at the least total cost.

    Pairs without a finite cost stay apart. Of all targets there are `group` bool[t], `is_gated` bool[t] and
    `feature_costs` float64[t, d]; `free` are rows of detections, of which those that are left are returned.
    """
    rows = table.rows
    members = np.flatnonzero(group & (rows["detection"] < 0))
    if not len(members) or not len(free):
        return free
    found = compare(rows, members, detected[free], feature_costs[np.ix_(members, free)], is_gated[members])
    taken, columns = scipy.optimize.linear_sum_assignment(np.fmin(found.costs, FORBIDDEN))
    is_allowed = np.isfinite(found.costs[taken, columns])
    taken, columns = taken[is_allowed], columns[is_allowed]
    left = np.ones(len(free), np.bool_)
    left[columns] = False
    owners, mismatch = members[taken], found.mismatch[taken, columns]
    crowded = (found.touched[columns] > 1) & (rows["state"][owners] != TENTATIVE) & ~rows["whole"][owners]
    rows["detection"][owners], rows["crowded"][owners] = free[columns], crowded
    rows["detection_std"][owners] += np.where(crowded, CROWDED_MISMATCH_STD, MISMATCH_STD) * mismatch
    rows["gate"][owners] = np.sqrt(np.maximum(found.distances[taken, columns], 0.0))
    return free[left]


def share_regions(
    rows: TargetRows, members: IndexArray, free: IndexArray, detected: FloatArray
) -> IndexArray:
    """Gives each region in which some of the targets `members` have become one to all of them.

    They lie in the region, and none of them fills it. Without this one of them would take it, or a new
    target, and the others end.

    Returns:
        The rows of `free` that are left.
    """
    taken = rows["detection"][members]
    regions = np.union1d(free, taken[taken >= 0])
    half, middle = rows["box"][members, None] / 2, rows["mean"][members, None, :2]
    first, last = detected[regions, LEFT:RIGHT], detected[regions, RIGHT:]
    low, high = np.maximum(middle - half, first), np.minimum(middle + half, last)
    common, areas = np.maximum(high - low, 0.0).prod(axis=2), 4 * half.prod(axis=2)
    lies_in = (common >= SHARED_OVERLAP * areas) & ((taken[:, None] < 0) | (taken[:, None] == regions))
    fills = common >= SHARED_OVERLAP * (areas + (last - first).prod(axis=1) - common)
    is_shared = (lies_in.sum(axis=0) > 1) & ~(lies_in & fills).any(axis=0)
    for column in np.flatnonzero(is_shared).tolist():
        sharing = members[lies_in[:, column] & (rows["detection"][members] == taken)]
        rows["detection"][sharing] = regions[column]
        rows["crowded"][sharing] = rows["shared"][sharing] = True
    return free[~np.isin(free, regions[is_shared])]


def _compare_features(
    models: Sequence[TargetModel], observation: Observation
) -> tuple[FloatArray, FloatArray]:
    """Differences of the detections' features from those of targets, and their costs, each float64[t, d].

    A difference is one minus the cosine with the mean, NaN where nothing compares. A cost is 0 for the same
    direction, up to 4 for the opposite. An object that is too unlike is another one: where one person covers
    another, boxes alone would go over from one to the other. Regions of motion merge and split, so that there
    it costs only.
    """
    unlike = np.full((len(models), len(observation.centroids)), np.nan)
    if observation.features is None:
        return unlike, np.zeros_like(unlike)
    known = {
        row: model.features
        for row, model in enumerate(models)
        if model.features is not None and model.features.version == observation.features_version
    }
    if known:
        means = np.array([features.mean for features in known.values()], np.float32)
        vectors = np.nan_to_num(observation.features)
        unlike[list(known)] = 1 - product(unit_rows(means), unit_rows(vectors).T)
    costs = FEATURE_WEIGHT * np.nan_to_num(unlike)
    if observation.are_objects:
        limits = np.array([math.inf if model.features is None else model.features.limit for model in models])
        costs[unlike > limits[:, None]] = np.inf
    return unlike, costs


def _learn_features(table: TargetTable, unlike: FloatArray, observation: Observation) -> None:
    """Lets detected targets learn the feature vectors of their detections."""
    if observation.features is None:
        return
    rate = OBJECT_FEATURE_RATE if observation.are_objects else FEATURE_RATE
    vectors = np.nan_to_num(np.asarray(observation.features, np.float64))
    for row, detection in enumerate(table.rows["detection"].tolist()):
        if detection < 0:
            continue
        model = table.models[row]
        vector, difference = vectors[detection], unlike.item(row, detection)
        if model.features is None or math.isnan(difference):
            # by itself: a row would keep all of them
            model.features = MeanFeatures(vector.copy(), observation.features_version)
        else:
            model.features.learn(vector, difference, rate)


@compiled
def compare(
    targets: TargetRows,
    members: IndexArray,
    detected: FloatArray,
    unlike: FloatArray,
    gated: BoolArray,
) -> Comparison:
    """Compares targets with detections.

    A pair is allowed within the gate; and, as a last choice, where the boxes overlap: a covariance that is
    too small must not make a second target of what lies upon the first. What detections show whole is paired
    by overlap, and, as a last choice, within the gate.

    Args:
        targets: the table, of which the expected `detection_std` is filled.
        members: intp[t], rows that are compared.
        detected: float64[d, 6], centroid x, y and box x0 y0 x1 y1, px.
        unlike: float64[t, d], added to the costs; infinite where the features forbid a pair.
        gated: bool[t], targets that, if they are whole, may be found within the gate.
    """
    shape = len(members), len(detected)
    costs, distances, mismatch = np.empty(shape), np.empty(shape), np.empty(shape)
    touched = np.zeros(len(detected), np.int64)
    for row in range(len(members)):
        target = targets[members[row]]
        x, y, width, height = target["mean"][0], target["mean"][1], target["box"][0], target["box"][1]
        std = centroid_std(np.sqrt(target["window"][LENGTH] * target["window"][WIDTH]))
        target["detection_std"] = std
        covariance = target["covariance"]
        xx, yy, xy = covariance[0, 0] + std**2, covariance[1, 1] + std**2, covariance[0, 1]
        determinant = max(xx * yy - xy**2, 1e-12)
        for column in range(len(detected)):
            seen = detected[column]
            right, down = seen[X] - x, seen[Y] - y
            distance = (yy * right**2 - 2 * xy * right * down + xx * down**2) / determinant
            sides = seen[RIGHT] - seen[LEFT], seen[BOTTOM] - seen[TOP]
            mismatch[row, column] = max(abs(sides[0] - width), abs(sides[1] - height))
            common_x = min(x + width / 2, seen[RIGHT]) - max(x - width / 2, seen[LEFT])
            common_y = min(y + height / 2, seen[BOTTOM]) - max(y - height / 2, seen[TOP])
            area, size, common = sides[0] * sides[1], width * height, max(common_x, 0.0) * max(common_y, 0.0)
            overlap = common / (area + size - common)
            holds = seen[LEFT] <= x <= seen[RIGHT] and seen[TOP] <= y <= seen[BOTTOM]
            touched[column] += holds or common > TOUCHING * min(area, size)
            relative = mismatch[row, column] / max(width, height, MIN_SIZE)
            cost = distance + relative**2 + unlike[row, column]
            if distance > GATE:
                cost = LAST_CHOICE + GATE * (1.0 - overlap) if overlap > MIN_OVERLAP else np.inf
            if target["whole"]:
                is_near = gated[row] and cost < LAST_CHOICE and relative < ALIKE
                cost = LAST_CHOICE + cost if is_near else np.inf
                if overlap > OBJECT_OVERLAP:
                    cost = GATE * (1.0 - overlap) + unlike[row, column]
            costs[row, column], distances[row, column] = cost, distance
    return Comparison(costs, distances, mismatch, touched)
