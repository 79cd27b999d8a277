"""Where a target's row in one frame comes from: kept beside the filter, read by nobody but the user."""

from __future__ import annotations

from dataclasses import dataclass


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
