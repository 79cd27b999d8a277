"""Pictures of a report: a crop of each target, and the frame with the most targets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

CROP_PX = 96
MARGIN = 0.3  # of the box's longer side, around it
FRAME_WIDTH_PX = 960
GREEN = (80, 220, 80)
Box = tuple[float, float, float, float]  # bounds x0 y0 x1 y1, px of the frame


def crop_jpeg(frame: NDArray[np.uint8], box: Box) -> bytes:
    """A square around a box, as JPEG.

    Args:
        frame: uint8[h, w, 3], BGR.
        box: the target's.
    """
    x0, y0, x1, y1 = box
    side = max(8.0, max(x1 - x0, y1 - y0) * (1 + 2 * MARGIN))
    centre = (x0 + x1) / 2, (y0 + y1) / 2
    patch = cv2.getRectSubPix(frame, (round(side), round(side)), centre)
    return _jpeg(cv2.resize(patch, (CROP_PX, CROP_PX), interpolation=cv2.INTER_AREA))


def frame_jpeg(frame: NDArray[np.uint8], boxes: dict[int, Box]) -> bytes:
    """A frame with the boxes of targets and their ids, as JPEG; at most 960 px wide.

    Args:
        frame: uint8[h, w, 3], BGR.
        boxes: of the targets, by id.
    """
    scale = min(1.0, FRAME_WIDTH_PX / frame.shape[1])
    drawn = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    for number, box in boxes.items():
        x0, y0, x1, y1 = (round(value * scale) for value in box)
        cv2.rectangle(drawn, (x0, y0), (x1, y1), GREEN, 1, cv2.LINE_AA)
        cv2.putText(drawn, str(number), (x0, y0 - 3), cv2.FONT_HERSHEY_SIMPLEX, 0.4, GREEN, 1, cv2.LINE_AA)
    return _jpeg(drawn)


def _jpeg(image: NDArray[Any]) -> bytes:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return bytes(data)
