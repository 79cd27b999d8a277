"""A mosaic of the ground that grows picture by picture."""

from functools import lru_cache
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, normalised, project, scale_change
from streamkit_stitcher.mosaic.canvas import Canvas
from streamkit_stitcher.mosaic.tiles import PictureArray
from streamkit_stitcher.plane.placement import drawn_out
from streamkit_stitcher.registration.patches import halved

_SCALE_RANGE: Final = (0.25, 4.0)
# How much farther away the far side of a picture may be than its near side: it is drawn out by the square.
_MOST_TILT: Final = 2.0
_SEAM_DEPTH: Final = 12


class Mosaic:
    """Pictures of one plane, joined where they lie equally deep inside their borders.

    Each pixel shows the picture in whose middle it lies most, with a short cross-fade along the seams; what
    only fills gaps gives way to all others. The canvas grows with the flight, from memory into a file, and
    is halved at its last limit, so a long flight loses resolution and not ground.

    Args:
        max_px: most pixels of the mosaic kept in memory.
        reduction: px of the pictures per px of the plane, where they come reduced.
    """

    def __init__(self, max_px: int, reduction: int = 1) -> None:
        self.canvas = Canvas(max_px, reduction)
        self._pictures = 0

    @property
    def pictures(self) -> int:
        """Number of pictures added."""
        return self._pictures

    @property
    def scale(self) -> float:
        """Mosaic pixels per px of the reference plane, 1 or a power of a half."""
        return self.canvas.scale

    @property
    def covered_px(self) -> float:
        """Covered area, in px of the reference plane."""
        return self.canvas.covered_px

    def picture(self) -> PictureArray | None:
        """The mosaic so far: uint8[h, w] or uint8[h, w, 3] BGR, black where no picture reached, or None."""
        if self.canvas.is_empty:
            return None
        left, top, right, bottom = self.canvas.box
        pixels, _ = self.canvas.read(left, top, right - left, bottom - top)
        return pixels[:, :, 0] if self.canvas.channels == 1 else pixels

    def uncovered(self, shape: tuple[int, int], to_reference: FloatArray) -> float:
        """Part of a picture that lies on no picture added so far, 0 to 1.

        Args:
            shape: (height, width) of the picture, px.
            to_reference: float64[3, 3], its pixels to the reference plane.
        """
        height, width = shape
        columns = (np.arange(32) + 0.5) * width / 32 - 0.5
        rows = (np.arange(18) + 0.5) * height / 18 - 0.5
        across, down = np.meshgrid(columns, rows)
        grid = np.stack([across.ravel(), down.ravel()], axis=1)
        cells = np.rint(project(normalised(self.canvas.from_plane @ to_reference), grid)).astype(np.int64)
        return 1.0 - float(np.count_nonzero(self.canvas.is_painted(cells))) / len(cells)

    def add(self, picture: PictureArray, to_reference: FloatArray, fills_gaps: bool = False) -> bool:
        """Lays a picture into the mosaic.

        Args:
            picture: uint8[h, w] grey or uint8[h, w, 3] BGR; it is turned into what the first one was.
            to_reference: float64[3, 3], its pixels to the reference plane.
            fills_gaps: whether it shows only where no other picture does, which keeps cars that drive along
                with the camera from being painted again and again.

        Returns:
            False, with the mosaic unchanged, where the place is degenerate, more than four times larger or
            smaller than the reference, or out of the canvas's reach.

        Raises:
            OSError: the temporary file takes no more.
        """
        shape = (picture.shape[0], picture.shape[1])
        if not is_placeable(self.canvas.from_picture(to_reference), shape):
            return False
        footprint = self.canvas.at_scale_one(project(to_reference, corners(shape)))
        if not self.canvas.make_room(footprint, 1 if picture.ndim == 2 else 3):
            return False
        self._paint(like(picture, self.canvas.channels), to_reference, 1 + _SEAM_DEPTH if fills_gaps else 255)
        self._pictures += 1
        return True

    def _paint(self, picture: PictureArray, to_reference: FloatArray, deepest: int) -> None:
        to_canvas = normalised(self.canvas.from_plane @ to_reference)
        picture, to_canvas = shrunk(picture, to_canvas)
        footprint = project(to_canvas, corners((picture.shape[0], picture.shape[1])))
        left, top = np.floor(footprint.min(axis=0)).astype(int).tolist()
        right, bottom = (np.ceil(footprint.max(axis=0)).astype(int) + 1).tolist()
        pixels, depth = self.canvas.read(left, top, right - left, bottom - top)
        to_box = normalised(np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]]) @ to_canvas)
        size = (right - left, bottom - top)
        warped = cv2.warpPerspective(picture, to_box, size, borderMode=cv2.BORDER_REPLICATE)
        flat = np.minimum(depth_inside((picture.shape[0], picture.shape[1])), np.uint8(deepest))
        deep = np.asarray(cv2.warpPerspective(flat, to_box, size, borderMode=cv2.BORDER_CONSTANT), np.uint8)
        share = cv2.addWeighted(deep, 0.5 / _SEAM_DEPTH, depth, -0.5 / _SEAM_DEPTH, 0.5, dtype=cv2.CV_32F)
        share[depth == 0] = 1
        share[deep == 0] = 0
        share = np.clip(share, 0, 1)
        blended = cv2.blendLinear(warped, pixels.reshape(warped.shape), share, 1 - share)
        painted = np.asarray(blended, dtype=np.uint8).reshape(pixels.shape)
        self.canvas.write(left, top, painted, np.maximum(depth, deep))


def is_placeable(to_reference: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether a picture of `shape` at a place is worth painting: neither huge, nor tiny, nor drawn out.

    Errors of perspective add up along a strip. One picture of a plane that has bent could cover as much of
    the canvas as all others together.
    """
    if not np.isfinite(to_reference).all():
        return False
    if not drawn_out(to_reference, shape) < _MOST_TILT:
        return False
    return _SCALE_RANGE[0] < scale_change(to_reference, shape) < _SCALE_RANGE[1]


def shrunk(picture: PictureArray, matrix: FloatArray) -> tuple[PictureArray, FloatArray]:
    """Halves a picture as often as `matrix`, float64[3, 3] from its pixels, shrinks it anyway."""
    while scale_change(matrix, (picture.shape[0], picture.shape[1])) < 0.6 and min(picture.shape[:2]) > 32:
        picture = halved(picture)
        matrix = normalised(matrix @ np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]]))
    return picture, matrix


@lru_cache(maxsize=8)
def depth_inside(shape: tuple[int, int]) -> PictureArray:
    """How deep each pixel of a picture lies inside it, uint8 from 1 at the border to 255 in the middle."""
    height, width = shape
    across = np.minimum(np.arange(width), np.arange(width)[::-1])
    down = np.minimum(np.arange(height), np.arange(height)[::-1])
    # The geometric mean of both distances: the smaller alone is the same for two pictures of a straight
    # flight wherever it is that of the other side, and half of what they share would show both.
    inward = np.sqrt(across[np.newaxis, :] * down[:, np.newaxis].astype(np.float64))
    depth = np.asarray(1 + inward * (254 / max(1.0, float(inward.max()))), dtype=np.uint8)
    depth.setflags(write=False)
    return depth


def like(picture: PictureArray, channels: int) -> PictureArray:
    """A picture in grey for one channel and in BGR for three."""
    if (picture.ndim == 2) == (channels == 1):
        return picture
    code = cv2.COLOR_GRAY2BGR if picture.ndim == 2 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(picture, code), dtype=np.uint8)
