"""Starts tentative targets on detections that no target was given."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import IndexArray, TargetTable

TENTATIVE_SHARE = 4


def add_tentative(
    table: TargetTable, observation: Observation, free: IndexArray, settings: TrackerSettings
) -> None:
    """Starts a tentative target on every free detection.

    Args:
        table: of the targets.
        observation: of this frame.
        free: rows of detections that no target was given.
        settings: of the tracker.
    """
    capacity = settings.max_targets * (1 + TENTATIVE_SHARE) - len(table.models)
    for index in free[: max(capacity, 0)].tolist():
        x, y = observation.centroids[index]
        width, height = observation.boxes[index, 2:] - observation.boxes[index, :2]
        born = table.add(
            np.array([x, y, width, height, 0.0]), settings, manual=False, cause="began on a detection"
        )
        table.rows["detection"][born], table.rows["whole"][born] = index, observation.are_objects
