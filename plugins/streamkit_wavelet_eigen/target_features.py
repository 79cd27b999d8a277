"""What is known about each window beside its feature vector."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class TargetFeatures:
    """Facts about the windows of one frame, row by row with `Features`; attached under its own type.

    Attributes:
        kind: what the rows are: `detections`, `tracks` or `window`.
        ids: int64[n], ids of tracks; row numbers otherwise.
        places: float64[n, 5], x y length width in px of the frame and angle in rad.
        version: of the space that the vectors are coordinates in.
        flat: bool[n], no structure: the vector is zero.
        clipped: float64[n], share of the window outside the picture, 0 to 1.
        tiny: bool[n], the target is below 8 px.
        errors: float32[n], root mean square reconstruction error, grey levels.
        energy: float32[n], share of the window's difference from the mean that the vector holds, 0 to 1.
        labels: nearest label of the gallery, "" where there is none; n names, or empty without a gallery.
        distances: float64[n] to it; empty without a gallery.
        margins: float64[n], how much nearer it is than the next other label, 0 to 1; empty without a gallery.
    """

    kind: str
    ids: NDArray[np.int64]
    places: NDArray[np.float64]
    version: int
    flat: NDArray[np.bool_]
    clipped: NDArray[np.float64]
    tiny: NDArray[np.bool_]
    errors: NDArray[np.float32]
    energy: NDArray[np.float32]
    labels: tuple[str, ...]
    distances: NDArray[np.float64]
    margins: NDArray[np.float64]
