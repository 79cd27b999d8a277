"""Steps of the camera too wide to be followed, as between the photographs of a survey."""

from typing import Final

import cv2
import numpy as np

from streamkit_stitcher.homographies import FloatArray, GreyArray, translation

_WIDTH: Final = 320
_SMALLEST_SIDE: Final = 16
_LEAST_RESPONSE: Final = 0.03


def jump(earlier: GreyArray, current: GreyArray, factor: int) -> FloatArray | None:
    """Guesses how far the camera went, by phase correlation over the whole pictures.

    It finds steps of up to half the picture where the camera hardly turned, good to a few pixels; whether
    they are true only a match can tell.

    Args:
        earlier: uint8[h, w], reduced by `factor`.
        current: uint8[h, w], the same.
        factor: the reduction.

    Returns:
        float64[3, 3], the shift of full-size pixels of `current` to those of `earlier`; None without a peak.

    Source: Kuglin and Hines, The phase correlation image alignment method, 1975.
    """
    height, width = current.shape
    scale = min(1.0, _WIDTH / width)
    size = max(_SMALLEST_SIDE, round(width * scale)), max(_SMALLEST_SIDE, round(height * scale))
    first, second = (
        cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in (earlier, current)
    )
    shift, response = cv2.phaseCorrelate(first, second, cv2.createHanningWindow(size, cv2.CV_32F))
    if not np.isfinite([*shift, response]).all() or response < _LEAST_RESPONSE:
        return None
    across, down = shift
    return translation(-factor * np.array([across * width / size[0], down * height / size[1]]))
