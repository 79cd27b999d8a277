"""A mosaic that is painted incrementally, frame by frame."""

from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, normalised, project, scale_change, translation
from streamkit_stitcher.mosaic.canvas import MosaicCanvas
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import depth_ratio
from streamkit_stitcher.registration.patches import halved

_SCALE_RANGE: Final = (0.25, 4.0)
# Largest depth ratio; the frame is stretched by its square.
_MAX_DEPTH_RATIO: Final = 2.0
_SEAM_DEPTH: Final = 12


class Mosaic:
    """Frames of one plane, joined where they are equally deep inside their borders.

    Each pixel shows the frame in which it is deepest, with a short cross-fade along the seams. The canvas
    grows with the flight, from memory into a file, and is halved when full: a long flight loses resolution,
    not ground.

    Args:
        max_px: most pixels in memory.
    """

    def __init__(self, max_px: int) -> None:
        self.canvas = MosaicCanvas(max_px)
        self._frames = 0

    @property
    def frames(self) -> int:
        """Number of frames added."""
        return self._frames

    @property
    def scale(self) -> float:
        """Mosaic pixels per px of the reference plane, 1 or a power of a half."""
        return self.canvas.scale

    def image(self) -> ImageArray | None:
        """The mosaic so far: uint8[h, w] or uint8[h, w, 3] BGR, black where there is no frame, or None."""
        if self.canvas.is_empty:
            return None
        left, top, right, bottom = self.canvas.box
        pixels, _ = self.canvas.read(left, top, right - left, bottom - top)
        return pixels[:, :, 0] if self.canvas.channels == 1 else pixels

    def add(self, frame: ImageArray, to_reference: FloatArray, fills_gaps: bool = False) -> bool:
        """Paints a frame, converted to the format of the first one.

        With `fills_gaps` it shows only where no other frame does, so that cars that keep pace with the camera
        are not painted again and again.

        Returns:
            False, with the mosaic unchanged, where the homography is degenerate, the scale differs from the
            reference by more than four, or the frame is out of the canvas's reach.

        Raises:
            OSError: the temporary file is full.
        """
        shape = (frame.shape[0], frame.shape[1])
        if not is_paintable(self.canvas.from_frame(to_reference), shape):
            return False
        footprint = self.canvas.at_scale_one(project(to_reference, corners(shape)))
        if not self.canvas.make_room(footprint, 1 if frame.ndim == 2 else 3):
            return False
        self._paint(
            with_channels(frame, self.canvas.channels), to_reference, 1 + _SEAM_DEPTH if fills_gaps else 255
        )
        self._frames += 1
        return True

    def _paint(self, frame: ImageArray, to_reference: FloatArray, deepest: int) -> None:
        to_canvas = normalised(self.canvas.from_plane @ to_reference)
        frame, to_canvas = reduced_for(frame, to_canvas)
        footprint = project(to_canvas, corners((frame.shape[0], frame.shape[1])))
        left, top = np.floor(footprint.min(axis=0)).astype(int).tolist()
        right, bottom = (np.ceil(footprint.max(axis=0)).astype(int) + 1).tolist()
        pixels, depth = self.canvas.read(left, top, right - left, bottom - top)
        to_box = normalised(translation(-np.array([left, top])) @ to_canvas)
        size = (right - left, bottom - top)
        warped = cv2.warpPerspective(frame, to_box, size, borderMode=cv2.BORDER_REPLICATE)
        flat = np.minimum(depth_inside((frame.shape[0], frame.shape[1])), np.uint8(deepest))
        deep = np.asarray(cv2.warpPerspective(flat, to_box, size, borderMode=cv2.BORDER_CONSTANT), np.uint8)
        share = cv2.addWeighted(deep, 0.5 / _SEAM_DEPTH, depth, -0.5 / _SEAM_DEPTH, 0.5, dtype=cv2.CV_32F)
        share[depth == 0] = 1
        share[deep == 0] = 0
        share = np.clip(share, 0, 1)
        blended = cv2.blendLinear(warped, pixels.reshape(warped.shape), share, 1 - share)
        painted = np.asarray(blended, dtype=np.uint8).reshape(pixels.shape)
        self.canvas.write(left, top, painted, np.maximum(depth, deep))


def is_paintable(to_reference: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether the footprint of a frame of `shape` is neither huge, nor tiny, nor stretched.

    Perspective errors accumulate along a strip: one frame could cover as much of the canvas as all others.
    """
    if not np.isfinite(to_reference).all():
        return False
    if not depth_ratio(to_reference, shape) < _MAX_DEPTH_RATIO:
        return False
    return _SCALE_RANGE[0] < scale_change(to_reference, shape) < _SCALE_RANGE[1]


def reduced_for(frame: ImageArray, matrix: FloatArray) -> tuple[ImageArray, FloatArray]:
    """Halves a frame while `matrix`, float64[3, 3] from its pixels, reduces it anyway."""
    while scale_change(matrix, (frame.shape[0], frame.shape[1])) < 0.6 and min(frame.shape[:2]) > 32:
        frame = halved(frame)
        matrix = normalised(matrix @ np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]]))
    return frame, matrix


@lru_cache(maxsize=8)
def depth_inside(shape: tuple[int, int]) -> ImageArray:
    """Depth of each pixel inside a frame, uint8 from 1 at the border to 255 in the middle."""
    height, width = shape
    across = np.minimum(np.arange(width), np.arange(width)[::-1])
    down = np.minimum(np.arange(height), np.arange(height)[::-1])
    # The geometric mean of both distances: the smaller one alone is equal for two frames of a straight flight
    # over half of their overlap, which would show both.
    inward = np.sqrt(across[np.newaxis, :] * down[:, np.newaxis].astype(np.float64))
    depth = np.asarray(1 + inward * (254 / max(1.0, float(inward.max()))), dtype=np.uint8)
    depth.setflags(write=False)
    return depth


def with_channels(frame: ImageArray, channels: int) -> ImageArray:
    """Converts a frame to grey for one channel and to BGR for three."""
    if (frame.ndim == 2) == (channels == 1):
        return frame
    code = cv2.COLOR_GRAY2BGR if frame.ndim == 2 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(frame, code), dtype=np.uint8)
