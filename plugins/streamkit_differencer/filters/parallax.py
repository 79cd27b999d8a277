"""Tall things under a moving camera: they slide over the ground against the camera's own motion.

A camera at height H that moves by c over the ground sees the top of a thing of height h slide by
-c h / (H - h). A vehicle that comes towards the camera no faster than that looks the same, and is lost with
them: that is what the filter costs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.float64]

POINTS_PER_OBJECT = 9
FEWEST_POINTS = 2
# A camera that moved less than this between the two frames shows no parallax, px.
SMALLEST_STEP_PX = 2.0
SIDEWAYS_PX = 0.5
SIDEWAYS_SHARE = 0.25
_FLOW: dict[str, Any] = {"winSize": (9, 9), "maxLevel": 1, "minEigThreshold": 1e-3}


def parallax_objects(
    earlier: ByteImage, current: ByteImage, boxes: FloatArray, camera_step: FloatArray, height_share: float
) -> BoolArray:
    """Which objects slide as tall things do, or do not move over the ground at all.

    Args:
        earlier: uint8[h, w], a frame on the canvas.
        current: uint8[h, w], a later one on the same canvas.
        boxes: float64[n, 4], x0 y0 x1 y1 of objects in `current`, canvas px.
        camera_step: float64[2], how far the camera's view moved over the canvas between the two, px.
        height_share: largest h / (H - h) looked for.

    Returns:
        bool[n].
    """
    distance = float(np.linalg.norm(camera_step))
    if not len(boxes) or distance < SMALLEST_STEP_PX:
        return np.zeros(len(boxes), bool)
    points = grid_points(boxes)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        current, earlier, points.reshape(-1, 1, 2).astype(np.float32), np.empty(0, np.float32), **_FLOW
    )
    moved = points.reshape(-1, 2) - found.reshape(-1, 2)
    moved[status.ravel() == 0] = np.nan
    per_object = moved.reshape(len(boxes), POINTS_PER_OBJECT, 2)
    seen = np.count_nonzero(np.isfinite(per_object[:, :, 0]), axis=1)
    median = np.zeros((len(boxes), 2))
    enough = seen >= FEWEST_POINTS
    median[enough] = np.nanmedian(per_object[enough], axis=1)
    against = -camera_step / distance
    along = median @ against
    sideways = np.abs(median @ np.array([-against[1], against[0]]))
    slides = (along > -SIDEWAYS_PX) & (along < height_share * distance)
    straight = sideways < np.maximum(SIDEWAYS_PX, SIDEWAYS_SHARE * np.abs(along))
    return np.asarray(enough & slides & straight, bool)


def grid_points(boxes: FloatArray) -> FloatArray:
    """Nine points in each box, float64[n, 9, 2]."""
    share = np.array([0.2, 0.5, 0.8])
    across = boxes[:, None, 0] + (boxes[:, 2] - boxes[:, 0])[:, None] * share
    down = boxes[:, None, 1] + (boxes[:, 3] - boxes[:, 1])[:, None] * share
    return np.stack([np.repeat(across, 3, axis=1), np.tile(down, (1, 3))], axis=2)
