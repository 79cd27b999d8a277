"""The targets that windows are cut around."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class TargetSource(StrEnum):
    """What windows are cut around."""

    DETECTIONS = "detections"
    TRACKS = "tracks"


@dataclass(frozen=True, eq=False)
class Targets:
    """Rotated boxes of the targets of a frame.

    Attributes:
        kind: `detections`, `tracks` or `window`.
        ids: int64[n], ids of tracks; row numbers otherwise.
        boxes: float64[n, 5], x y length width angle.
    """

    kind: str
    ids: NDArray[np.int64]
    boxes: NDArray[np.float64]


def fixed_window(text: str) -> Targets:
    """The window `x,y,w,h` or `x,y,w,h,angle`: left, top and size in px, rotation about its centre in rad.

    Raises:
        ValueError: the text has another form.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 5) or not np.isfinite(numbers).all() or min(numbers[2:4]) <= 0:
        raise ValueError(
            f"must be x,y,w,h or x,y,w,h,angle with w and h above 0, got {text!r}; "
            "write for example window=100,80,40,20"
        )
    left, top, width, height, angle = [*numbers, 0.0][:5]
    box = np.array([[left + (width - 1) / 2, top + (height - 1) / 2, width, height, angle]])
    return Targets("window", np.zeros(1, np.int64), box)
