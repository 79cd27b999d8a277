"""Gives the detections of a frame to the targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product
from streamkit_tracker.association import REACH, STD, assign, compare
from streamkit_tracker.box_shape import BOX_HEIGHT
from streamkit_tracker.detected_shape import centroid_std
from streamkit_tracker.feature_template import unit_rows
from streamkit_tracker.observation import Observation, Sighting
from streamkit_tracker.target import Target
from streamkit_tracker.window_geometry import FloatArray, window_sides

IndexArray = NDArray[np.intp]

MISMATCH_STD = 0.12
CROWDED_MISMATCH_STD = 0.5
FEATURE_WEIGHT, FEATURE_RATE = 2.0, 0.2
SHARED_AREA = 1.4
# Whether targets are followed and dormant, in the order in which they choose.
SEEN, DORMANT, TENTATIVE = (True, False), (True, True), (False, False)


@dataclass(frozen=True, eq=False)
class Pairing:
    """Who was detected.

    Attributes:
        sightings: by target id.
        gates: by target id, distance of its detection from where it was expected, standard deviations.
        shared: ids of targets covered by a detection that went to another target.
        free: indices of detections that nobody took.
    """

    sightings: dict[int, Sighting] = field(default_factory=dict)
    gates: dict[int, float] = field(default_factory=dict)
    shared: frozenset[int] = frozenset()
    free: tuple[int, ...] = ()


def pair(targets: Sequence[Target], observation: Observation, max_speed: float) -> Pairing:
    """Gives detections first to targets that are followed, and what is left to the tentative ones.

    Args:
        targets: predicted for this frame.
        observation: of this frame.
        max_speed: fastest target expected, px/s.
    """
    detected = np.concatenate([observation.centroids, observation.boxes], axis=1, dtype=np.float64)
    usable = np.isfinite(detected).all(axis=1) & (detected[:, 4:] > detected[:, 2:4]).all(axis=1)
    free = np.flatnonzero(usable)
    rows: list[list[float]] = detected.tolist()
    sightings: dict[int, Sighting] = {}
    gates: dict[int, float] = {}
    shared: frozenset[int] = frozenset()
    for (followed, dormant), group in _groups(targets).items():
        if not group or not len(free):
            continue
        expected = _expected(group, max_speed * observation.step_s)
        found = compare(expected, detected[free], _feature_costs(group, free, observation))
        pairs = assign(found.costs, np.isfinite(found.costs))
        stds, touched = expected[:, STD].tolist(), found.touched.tolist()
        columns = [column for _, column in pairs]
        left = np.ones(len(free), np.bool_)
        left[columns] = False
        for row, column in pairs:
            crowded = followed and touched[column] > 1
            factor = CROWDED_MISMATCH_STD if crowded else MISMATCH_STD
            std = stds[row] + factor * found.mismatch.item(row, column)
            number, index = group[row].id, free.item(column)
            sightings[number] = _sighting(observation, rows[index], index, std, crowded=crowded)
            gates[number] = math.sqrt(max(found.distances.item(row, column), 0.0))
        if followed and not dormant:
            shared = _shared(group, [row for row, _ in pairs], detected[free[columns]])
            # what lies upon a target that is followed already must not start another one there
            left &= found.held == 0
        free = free[left]
    return Pairing(sightings, gates, shared, tuple(free.tolist()))


def _groups(targets: Sequence[Target]) -> dict[tuple[bool, bool], list[Target]]:
    groups: dict[tuple[bool, bool], list[Target]] = {SEEN: [], DORMANT: [], TENTATIVE: []}
    for target in targets:
        followed = target.followed
        groups[followed, followed and target.dormant].append(target)
    return groups


def _expected(group: Sequence[Target], step: float) -> FloatArray:
    """Rows for `compare`; `step` is the farthest a target can come in one frame, px."""
    means, covariances = np.array([t.mean for t in group]), np.array([t.covariance for t in group])
    rows = np.empty((len(group), 9))
    rows[:, :2], rows[:, 2:4], rows[:, 4] = means[:, :2], covariances[:, 0, :2], covariances[:, 1, 1]
    rows[:, 5:7] = np.array([target.shape.numbers for target in group])[:, : BOX_HEIGHT + 1]
    rows[:, STD] = centroid_std(window_sides(np.array([target.window for target in group])))
    rows[:, REACH] = [step * (1 + target.frames_undetected) for target in group]
    return rows


def _feature_costs(group: list[Target], free: IndexArray, observation: Observation) -> FloatArray:
    """What the detections' feature vectors add: 0 for the same direction, up to 4 for the opposite."""
    costs = np.zeros((len(group), len(free)))
    if observation.features is None:
        return costs
    vectors = unit_rows(np.nan_to_num(observation.features[free]))
    version = observation.features_version
    rows = [row for row, target in enumerate(group) if _compares(target, version)]
    if rows:
        features = unit_rows(np.array([group[row].feature for row in rows], np.float32))
        costs[rows] = FEATURE_WEIGHT * (1.0 - product(features, vectors.T))
    return costs


def remember_features(targets: Sequence[Target], sightings: Sequence[Sighting], version: int) -> None:
    """Lets the feature vectors of targets follow those of their detections.

    Args:
        targets: n of them.
        sightings: theirs in this frame.
        version: of the space that the detections' vectors are in.
    """
    seen = [(t, s.feature) for t, s in zip(targets, sightings, strict=True) if s.feature is not None]
    if not seen:
        return
    vectors = np.array([feature for _, feature in seen], np.float64)
    rows = [row for row, (target, _) in enumerate(seen) if _compares(target, version)]
    if rows:
        known = np.array([seen[row][0].feature for row in rows])
        vectors[rows] = (1 - FEATURE_RATE) * known + FEATURE_RATE * vectors[rows]
    for (target, _), vector in zip(seen, vectors, strict=True):
        target.feature, target.feature_version = vector, version


def _compares(target: Target, version: int) -> bool:
    """Whether a target has a feature vector of this version."""
    return target.feature_version == version and target.feature is not None


def _shared(group: list[Target], paired: list[int], taken: FloatArray) -> frozenset[int]:
    """Ids of those left over whom the box of another holds too, one that is too big for the other alone."""
    left = sorted(set(range(len(group))).difference(paired))
    if not left or not paired:
        return frozenset()
    alone = np.array([math.prod(group[row].shape.box) for row in paired])
    wide = taken[np.prod(taken[:, 4:] - taken[:, 2:4], axis=1) > SHARED_AREA * alone]
    boxes = wide[:, 2:].tolist()
    places = {group[row].id: group[row].mean.tolist() for row in left}
    return frozenset(
        number
        for number, (x, y, _, _) in places.items()
        if any(x0 <= x <= x1 and y0 <= y <= y1 for x0, y0, x1, y1 in boxes)
    )


def _sighting(
    observation: Observation, detected: list[float], index: int, std: float, *, crowded: bool
) -> Sighting:
    x, y, x0, y0, x1, y1 = detected
    feature = None if observation.features is None else observation.features[index]
    version = observation.features_version
    size = (max(x1 - x0, 1.0), max(y1 - y0, 1.0))
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    return Sighting((x, y), size, middle, std, crowded, feature, version, index)
