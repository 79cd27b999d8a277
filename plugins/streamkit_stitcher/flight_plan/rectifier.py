"""Frames of one camera undistorted, levelled and cropped to one size."""

import math
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray
from streamkit_stitcher.flight_plan.rectification import (
    CameraIntrinsics,
    MapArray,
    inscribed_rectangle,
    levelling,
    rectification_maps,
    rectified_border,
)

PixelArray = npt.NDArray[np.uint8]

_DIRECTIONS: Final = 8


class Rectifier:
    """Rectifies frames up to a maximal tilt; all have the same size.

    Args:
        camera: intrinsic parameters of the camera.
        shape: (height, width) of its frames, px.
        aspect: width over height of the crop.
        max_tilt: tilt up to which the crop is filled, rad.

    Attributes:
        size: width and height of the rectified frames, px, both even.

    Raises:
        ValueError: nothing can be cropped, or the tilt exceeds 45 degrees.
    """

    def __init__(
        self, camera: CameraIntrinsics, shape: tuple[int, int], aspect: float, max_tilt: float
    ) -> None:
        self._camera, self._shape, self._aspect, self._max_tilt = camera, shape, aspect, max_tilt
        turns = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS) if max_tilt > 0 else np.empty(0)
        tilts = [(0.0, 0.0), *((max_tilt * math.cos(turn), max_tilt * math.sin(turn)) for turn in turns)]
        inscribed = [self._inscribed(self._to_level(*tilt)) for tilt in tilts]
        width = min(min(wide, high * aspect) for _, _, wide, high in inscribed)
        self.size: tuple[int, int] = _even(width), _even(width / aspect)
        if not (math.isfinite(width) and min(self.size) > 1):
            raise ValueError(
                f"nothing can be cut out of {shape[1]} x {shape[0]} px at a tilt of "
                f"{math.degrees(max_tilt):.1f} degrees: check the camera's focal length and distortion"
            )
        self._tilt: tuple[float, float] | None = None
        self._maps: tuple[MapArray, MapArray] | None = None

    def can_level(self, roll: float, pitch: float) -> bool:
        """Whether a tilt, rad, is within the maximum."""
        return math.hypot(roll, pitch) <= self._max_tilt + 1e-9

    def maps(self, roll: float, pitch: float) -> tuple[MapArray, MapArray]:
        """Source position of each pixel of the rectified frame, float32[h, w] columns and rows.

        Roll and pitch are as in `rectification.levelling`, rad, limited to the maximal tilt.
        """
        excess = math.hypot(roll, pitch) / self._max_tilt if self._max_tilt > 0 else math.inf
        tilt = (roll / excess, pitch / excess) if excess > 1 else (roll, pitch)
        if self._maps is None or tilt != self._tilt:
            to_level = self._to_level(*tilt)
            left, top, width, height = self._inscribed(to_level)
            shift = np.array([left + (width - self.size[0]) / 2, top + (height - self.size[1]) / 2])
            self._maps = rectification_maps(self._camera, self._shape, to_level, self.size, shift)
            self._tilt = tilt
        return self._maps

    def _to_level(self, roll: float, pitch: float) -> FloatArray:
        return levelling(self._camera, self._shape, roll, pitch)

    def _inscribed(self, to_level: FloatArray) -> tuple[float, float, float, float]:
        return inscribed_rectangle(rectified_border(self._camera, self._shape, to_level), self._aspect)


def resampled(plane: PixelArray, maps: tuple[MapArray, MapArray]) -> PixelArray:
    """Resamples uint8[h, w] or uint8[h, w, 3] by `Rectifier.maps`."""
    warped = cv2.remap(plane, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped, dtype=np.uint8)


def halved_maps(maps: tuple[MapArray, MapArray]) -> tuple[MapArray, MapArray]:
    """The maps for planes of half the width and height, as the chroma of I420."""
    height, width = maps[0].shape
    columns, rows = (
        (cv2.resize(one, (width // 2, height // 2), interpolation=cv2.INTER_AREA) - 0.5) / 2 for one in maps
    )
    return np.asarray(columns, dtype=np.float32), np.asarray(rows, dtype=np.float32)


def _even(length: float) -> int:
    return 2 * math.floor(length / 2) if math.isfinite(length) else 0
