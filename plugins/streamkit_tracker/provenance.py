"""Where a target's row in one frame comes from: kept beside the filter, read by nobody but the user."""

from __future__ import annotations

import math
from dataclasses import dataclass

from streamkit_tracker.window_geometry import FloatArray


@dataclass
class TargetProvenance:
    """What one frame did to one target; a new one for each frame, filled while the frame is worked on.

    Attributes:
        predicted: x and y before the frame was looked at, px; None in a target's first frame.
        detection: row of the frame's detections that was given to the target, or None.
        gate: distance of that detection from the predicted place, standard deviations.
        shared: whether the detection of another target covers this one too.
        similarity: of the best window to the template, 0 to 1; None where the pixels were not looked at.
        learnt: whether the template took that window in.
        cause: why the target began, was confirmed or ended in this frame; else empty.
    """

    predicted: tuple[float, float] | None = None
    detection: int | None = None
    gate: float | None = None
    shared: bool = False
    similarity: float | None = None
    learnt: bool = False
    cause: str = ""


def gate_distance(
    mean: FloatArray, covariance: FloatArray, centroid: tuple[float, float], std: float
) -> float:
    """Distance of a detection from where a target is expected, in standard deviations.

    Args:
        mean: float64[4], predicted x y vx vy.
        covariance: float64[4, 4].
        centroid: of the detection, px.
        std: standard deviation of such a centroid, px.
    """
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    across, down = centroid[0] - float(mean[0]), centroid[1] - float(mean[1])
    xx, yy = xx + std**2, yy + std**2
    quadratic = yy * across**2 - 2 * xy * across * down + xx * down**2
    return math.sqrt(max(quadratic / max(xx * yy - xy**2, 1e-12), 0.0))
