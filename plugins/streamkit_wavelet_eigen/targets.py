"""The targets of a frame that windows are cut around: its detections, its tracks, or one fixed window."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from streamkit import Detections, Frame, PropertyError, Tracks
from streamkit_wavelet_eigen.windows import rotated_boxes


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


TargetReader = Callable[[Frame], Targets | None]


def read_detections(frame: Frame) -> Targets | None:
    """The frame's detections, or None without any."""
    detections = frame.get(Detections)
    if detections is None or not len(detections):
        return None
    boxes = rotated_boxes(detections.centroids, detections.boxes)
    return Targets("detections", np.arange(len(boxes)), boxes)


def read_tracks(frame: Frame) -> Targets | None:
    """The frame's tracks, or None without any."""
    tracks = frame.get(Tracks)
    if tracks is None or not tracks.tracks:
        return None
    rows = [(one.x, one.y, one.length, one.width, one.angle) for one in tracks.tracks]
    ids = np.array([one.id for one in tracks.tracks], np.int64)
    return Targets("tracks", ids, np.array(rows, np.float64))


def fixed_window(text: str, element: str) -> TargetReader:
    """Reads one window, the same in every frame.

    Args:
        text: `x,y,w,h` or `x,y,w,h,angle`: left, top and size in px, and rotation about its centre in rad.
        element: name for the error.

    Raises:
        PropertyError: the text has another form.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 5) or not np.isfinite(numbers).all() or min(numbers[2:4]) <= 0:
        raise PropertyError(
            f"{element}: property window must be x,y,w,h or x,y,w,h,angle with w and h above 0, "
            f"got {text!r}; write for example window=100,80,40,20"
        )
    left, top, width, height, angle = [*numbers, 0.0][:5]
    box = np.array([[left + (width - 1) / 2, top + (height - 1) / 2, width, height, angle]])
    targets = Targets("window", np.zeros(1, np.int64), box)
    return lambda frame: targets
