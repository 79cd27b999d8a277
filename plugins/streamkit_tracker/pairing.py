"""Gives the detections of a frame to the targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product
from streamkit_tracker.association import STD, assign, compare
from streamkit_tracker.detected_shape import centroid_std
from streamkit_tracker.feature_template import unit_rows
from streamkit_tracker.observation import Observation, Sighting
from streamkit_tracker.target import Target
from streamkit_tracker.window_geometry import FloatArray

IndexArray = NDArray[np.intp]

MISMATCH_STD = 0.12
CROWDED_MISMATCH_STD = 0.5
FEATURE_WEIGHT = 2.0
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
    sightings: dict[int, Sighting] = {}
    gates: dict[int, float] = {}
    shared: frozenset[int] = frozenset()
    for (followed, dormant), group in _groups(targets).items():
        if not group or not len(free):
            continue
        expected = np.array([_expected(target, max_speed * observation.step_s) for target in group])
        found = compare(expected, detected[free], _feature_costs(group, free, observation))
        pairs = assign(found.costs, np.isfinite(found.costs))
        columns = [column for _, column in pairs]
        left = np.ones(len(free), np.bool_)
        left[columns] = False
        for row, column in pairs:
            crowded = followed and found.touched.item(column) > 1
            factor = CROWDED_MISMATCH_STD if crowded else MISMATCH_STD
            std = expected.item(row, STD) + factor * found.mismatch.item(row, column)
            number, index = group[row].id, free.item(column)
            sightings[number] = _sighting(observation, detected[index], index, std, crowded=crowded)
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
        groups[target.followed, target.followed and target.dormant].append(target)
    return groups


def _expected(target: Target, step: float) -> tuple[float, ...]:
    """A target's row for `compare`; `step` is the farthest it can come in one frame, px."""
    x, y, _, _ = target.mean.tolist()
    (xx, xy, _, _), (_, yy, _, _), _, _ = target.covariance.tolist()
    reach = step * (1 + target.frames_undetected)
    return x, y, xx, xy, yy, *target.shape.box, centroid_std(target.side), reach


def _feature_costs(group: list[Target], free: IndexArray, observation: Observation) -> FloatArray:
    """What the detections' feature vectors add: 0 for the same direction, up to 4 for the opposite."""
    costs = np.zeros((len(group), len(free)))
    if observation.features is None:
        return costs
    vectors = unit_rows(np.nan_to_num(observation.features[free]))
    version = observation.features_version
    known = [(row, t.feature) for row, t in enumerate(group) if t.feature_version == version]
    rows = [row for row, feature in known if feature is not None]
    if rows:
        features = unit_rows(np.stack([f for _, f in known if f is not None]).astype(np.float32))
        costs[rows] = FEATURE_WEIGHT * (1.0 - product(features, vectors.T))
    return costs


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
    observation: Observation, detected: FloatArray, index: int, std: float, *, crowded: bool
) -> Sighting:
    x, y, x0, y0, x1, y1 = detected.tolist()
    feature = None if observation.features is None else observation.features[index]
    version = observation.features_version
    size = (max(x1 - x0, 1.0), max(y1 - y0, 1.0))
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    return Sighting((x, y), size, middle, std, crowded, feature, version, index)
