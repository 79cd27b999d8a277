"""Metadata about the windows that feature vectors were made from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class TargetFeatures:
    """Metadata of the windows of a frame, row by row with `Features`.

    Attributes:
        kind: source of the rows: `detections`, `tracks` or `window`.
        ids: int64[n], ids of tracks; row numbers otherwise.
        boxes: float64[n, 5], x y length width in px of the frame and angle in rad.
        version: of the space of the vectors.
        flat: bool[n], no structure: the vector is zero.
        clipped: float64[n], share of the window outside the frame, 0 to 1.
        tiny: bool[n], the target is below 8 px.
        errors: float32[n], root mean square reconstruction error, grey levels.
        energy: float32[n], share of the window's difference from the mean in the vector, 0 to 1.
        labels: nearest label of the gallery, "" where there is none; n names, or empty without a gallery.
        distances: float64[n] to it; empty without a gallery.
        margins: float64[n], how much nearer it is than the next other label, 0 to 1; empty without a gallery.
    """

    kind: str
    ids: NDArray[np.int64]
    boxes: NDArray[np.float64]
    version: int
    flat: NDArray[np.bool_]
    clipped: NDArray[np.float64]
    tiny: NDArray[np.bool_]
    errors: NDArray[np.float32]
    energy: NDArray[np.float32]
    labels: tuple[str, ...]
    distances: NDArray[np.float64]
    margins: NDArray[np.float64]
