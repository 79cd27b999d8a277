"""Gives the detections of a frame to the targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.association import assign, mahalanobis_squared
from streamkit_tracker.calling_thread import product
from streamkit_tracker.detected_shape import centroid_std
from streamkit_tracker.feature_template import unit_rows
from streamkit_tracker.observation import Observation, Sighting
from streamkit_tracker.target import Target
from streamkit_tracker.window_geometry import FloatArray

IndexArray = NDArray[np.intp]

GATE = 16.0
LEAST_UPON, LAST_CHOICE = 0.15, 100.0
MISMATCH_STD = 0.12
CROWDED_MISMATCH_STD = 0.5
FEATURE_WEIGHT = 2.0
SHARED_AREA = 1.4
TOUCHING = 0.05


@dataclass(frozen=True, eq=False)
class Pairing:
    """Who was detected.

    Attributes:
        sightings: by target id.
        shared: ids of targets covered by a detection that went to another target.
        free: indices of detections that nobody took.
    """

    sightings: dict[int, Sighting] = field(default_factory=dict)
    shared: frozenset[int] = frozenset()
    free: tuple[int, ...] = ()


def pair(targets: Sequence[Target], observation: Observation, max_speed: float) -> Pairing:
    """Gives detections first to targets that are followed, and what is left to the tentative ones.

    Args:
        targets: predicted for this frame.
        observation: of this frame.
        max_speed: fastest target expected, px/s.
    """
    usable = np.isfinite(observation.centroids).all(axis=1) & np.isfinite(observation.boxes).all(axis=1)
    usable &= (observation.boxes[:, 2:] > observation.boxes[:, :2]).all(axis=1)
    free = np.flatnonzero(usable)
    sightings: dict[int, Sighting] = {}
    shared: frozenset[int] = frozenset()
    for followed, dormant in ((True, False), (True, True), (False, False)):
        group = [t for t in targets if t.followed is followed and (t.followed and t.dormant) is dormant]
        if not group or not len(free):
            continue
        costs, mismatch = _costs(group, free, observation, max_speed)
        pairs = assign(costs, np.isfinite(costs))
        held, touched = _held(group, observation.boxes[free])
        for row, column in pairs:
            target, detection = group[row], int(free[column])
            crowded = followed and bool(touched[column] > 1)
            factor = CROWDED_MISMATCH_STD if crowded else MISMATCH_STD
            std = centroid_std(target.side) + factor * float(mismatch[row, column])
            sightings[target.id] = _sighting(observation, detection, std, crowded=crowded)
        taken = free[[column for _, column in pairs]]
        if followed and not dormant:
            unpaired = [target for target in group if target.id not in sightings]
            paired = [group[row] for row, _ in pairs]
            boxes = observation.boxes[taken]
            shared = frozenset(target.id for target in unpaired if _shares(target, paired, boxes))
        left = np.isin(free, taken, invert=True)
        if followed and not dormant:
            # what lies upon a target that is followed already must not start another one there
            left &= held == 0
        free = free[left]
    return Pairing(sightings, shared, tuple(int(index) for index in free))


def _costs(
    group: list[Target], free: IndexArray, observation: Observation, max_speed: float
) -> tuple[FloatArray, FloatArray]:
    """Costs float64[t, d], infinite outside the gate, and how far the boxes miss the targets' sizes, px."""
    boxes, centroids = observation.boxes[free], observation.centroids[free]
    positions = np.stack([target.mean[:2] for target in group])
    covariances = np.stack([target.covariance[:2, :2] for target in group])
    sizes = np.array([target.shape.box for target in group])
    missed = np.abs((boxes[:, 2:] - boxes[:, :2])[None] - sizes[:, None])
    mismatch = np.maximum(missed[..., 0], missed[..., 1])
    base = np.array([centroid_std(target.side) for target in group])[:, None]
    gates = mahalanobis_squared(positions, covariances, centroids, base)
    offsets = centroids[None] - positions[:, None]
    steps = np.array([max_speed * observation.step_s * (1 + t.frames_undetected) for t in group])[:, None]
    outside = (gates > GATE) | (np.hypot(offsets[..., 0], offsets[..., 1]) > steps + 4 * base)
    costs = gates + (mismatch / np.maximum(sizes.max(axis=1), 4.0)[:, None]) ** 2
    costs += _feature_costs(group, free, observation)
    # a covariance that is too small must not make a second target of what lies upon the first
    upon = _upon(positions, sizes, boxes)
    costs[outside] = np.where(upon > LEAST_UPON, LAST_CHOICE + GATE * (1.0 - upon), np.inf)[outside]
    return costs, mismatch


def _upon(positions: FloatArray, sizes: FloatArray, boxes: FloatArray) -> FloatArray:
    """Overlap of every target's box with every detection's, intersection over union: float64[t, d]."""
    low = np.maximum((positions - sizes / 2)[:, None], boxes[None, :, :2])
    high = np.minimum((positions + sizes / 2)[:, None], boxes[None, :, 2:])
    shared = np.maximum(high - low, 0.0)
    common = shared[..., 0] * shared[..., 1]
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    return np.asarray(common / (np.prod(sizes, axis=1)[:, None] + areas - common))


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


def _shares(target: Target, paired: list[Target], boxes: FloatArray) -> bool:
    """Whether the box of another target holds this one too and is too big for the other alone."""
    x, y = target.mean[:2]
    holds = (boxes[:, 0] <= x) & (x <= boxes[:, 2]) & (boxes[:, 1] <= y) & (y <= boxes[:, 3])
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    alone = np.array([other.shape.box[0] * other.shape.box[1] for other in paired])
    return bool(np.any(holds & (areas > SHARED_AREA * alone)))


def _held(group: list[Target], boxes: FloatArray) -> tuple[IndexArray, IndexArray]:
    """How many targets have their centre in each box, and how many a part of themselves: intp[d] both."""
    centres = np.stack([target.mean[:2] for target in group])
    sizes = np.array([target.shape.box for target in group])
    inside = np.all((boxes[:, None, :2] <= centres) & (centres <= boxes[:, None, 2:]), axis=2)
    low = np.maximum(centres - sizes / 2, boxes[:, None, :2])
    high = np.minimum(centres + sizes / 2, boxes[:, None, 2:])
    shared = np.maximum(high - low, 0.0)
    common = shared[..., 0] * shared[..., 1]
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)[:, None]
    touched = inside | (common > TOUCHING * np.minimum(areas, np.prod(sizes, axis=1)))
    return _counted(inside), _counted(touched)


def _counted(marks: NDArray[Any]) -> IndexArray:
    return np.asarray(np.count_nonzero(marks, axis=1), np.intp)


def _sighting(observation: Observation, index: int, std: float, *, crowded: bool) -> Sighting:
    x, y = observation.centroids[index].tolist()
    x0, y0, x1, y1 = observation.boxes[index].tolist()
    feature = None if observation.features is None else observation.features[index]
    version = observation.features_version
    size = (max(x1 - x0, 1.0), max(y1 - y0, 1.0))
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    return Sighting((x, y), size, middle, std, crowded, feature, version, index)
