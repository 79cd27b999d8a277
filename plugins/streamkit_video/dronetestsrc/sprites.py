"""Sprites of cars seen from above, and drawing them into a frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.homography import project, translation

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]

# Paint, BGR: all differ from the brightness of the ground, which is near 115.
COLOURS = (
    (238, 240, 240), (24, 22, 22), (205, 206, 204), (92, 36, 22), (52, 205, 238),
    (28, 22, 112), (178, 212, 226), (44, 62, 20), (240, 228, 190), (40, 40, 44),
)  # fmt: skip
GLASS = (46.0, 38.0, 32.0)
RESOLUTION = 2.0  # sprite px per frame px at mean altitude
OVERSAMPLING = 4
MARGIN = 4.0
BODY_BLUR = 0.7
SHADOW_BLUR = 1.6
SHADOW_STRENGTH = 0.5
SHADOW_OFFSET = (2.2, 3.0)  # offset of the shadow, frame px along the ground axes


@dataclass(frozen=True, slots=True, eq=False)
class CarSprite:
    """One car, heading towards +x of its sprite.

    Attributes:
        body: float32[h, w, channels + 1], premultiplied colour, and alpha, 0 to 1.
        shadow: float32[h, w], share of light that the shadow absorbs, 0 to 1.
        local_from_sprite: float64[3, 3], sprite pixels to ground px about the centre of the body.
    """

    body: Float32Array
    shadow: Float32Array
    local_from_sprite: FloatArray

    def draw(self, layers: Float32Array, image: ByteArray, frame_from_local: FloatArray) -> None:
        """Draws the layers of body or shadow into an image, uint8[h, w] or [h, w, 3], in place."""
        frame_from_sprite = frame_from_local @ self.local_from_sprite
        rows, columns = layers.shape[:2]
        border = np.array([(-1.0, -1.0), (columns, -1), (columns, rows), (-1, rows)])
        outline = project(frame_from_sprite, border)
        limits = np.array(image.shape[1::-1])
        left, top = np.maximum(np.floor(outline.min(axis=0)), 0).astype(int).tolist()
        right, bottom = np.minimum(np.ceil(outline.max(axis=0)) + 1, limits).astype(int).tolist()
        if right <= left or bottom <= top:
            return
        frame_from_sprite = translation(np.array([-left, -top])) @ frame_from_sprite
        warped = cv2.warpPerspective(
            layers, frame_from_sprite, (right - left, bottom - top), flags=cv2.INTER_LINEAR
        )
        part = image[top:bottom, left:right]
        shape = part.shape
        warped = warped.reshape(*shape[:2], -1)
        behind, colour = 1.0 - warped[:, :, -1:], warped[:, :, :-1] if layers.ndim == 3 else 0.0
        part[...] = np.rint(part.reshape(*shape[:2], -1) * behind + colour).reshape(shape)


def paint_car(
    length: float, width: float, colour: tuple[int, int, int], scale: float, channels: int
) -> CarSprite:
    """Paints a car seen from above.

    Args:
        length: frame px.
        width: frame px.
        colour: BGR paint.
        scale: ground px per frame px.
        channels: 1 for grey, 3 for BGR.
    """
    half = np.array([length, width]) / 2.0 * RESOLUTION * OVERSAMPLING
    columns, rows = (
        OVERSAMPLING * int(np.ceil((side + 2 * MARGIN) * RESOLUTION)) for side in (length, width)
    )
    # Symmetric front and rear, so that the centre of the body is the centre of the silhouette.
    hull = [(0.87, 1), (1, 0.6), (1, -0.6), (0.87, -1), (-0.87, -1), (-1, -0.6), (-1, 0.6), (-0.87, 1)]
    silhouette = np.zeros((rows, columns, 3), np.uint8)
    _fill(silhouette, half, hull, (255.0, 255.0, 255.0))
    coverage = silhouette[:, :, :1].astype(np.float32) / 255.0
    lit = _lit_paint((rows, columns), half, colour)
    if channels == 1:
        lit = np.asarray(cv2.cvtColor(lit, cv2.COLOR_BGR2GRAY), np.float32)[:, :, None]
    small = (columns // OVERSAMPLING, rows // OVERSAMPLING)
    fine = np.concatenate([lit * coverage, coverage], axis=2)
    body = cv2.GaussianBlur(cv2.resize(fine, small, interpolation=cv2.INTER_AREA), (0, 0), BODY_BLUR)
    soft = cv2.GaussianBlur(cv2.resize(coverage, small, interpolation=cv2.INTER_AREA), (0, 0), SHADOW_BLUR)
    unit = scale / RESOLUTION
    local_from_sprite = np.diag([unit, unit, 1.0])
    local_from_sprite[:2, 2] = -unit * (np.array(small) - 1) / 2.0
    shadow = SHADOW_STRENGTH * soft
    return CarSprite(np.asarray(body, np.float32), np.asarray(shadow, np.float32), local_from_sprite)


def _lit_paint(shape: tuple[int, int], half: FloatArray, colour: tuple[int, int, int]) -> Float32Array:
    """float32[h, w, 3]: paint, a brighter roof between dark windows, darker sides."""
    canvas = np.empty((*shape, 3), np.uint8)
    canvas[:] = colour
    blue, green, red = (min(255.0, 1.12 * level + 8.0) for level in colour)
    _fill(canvas, half, [(0.48, -0.84), (0.48, 0.84), (0.16, 0.7), (0.16, -0.7)], GLASS)
    _fill(canvas, half, [(-0.72, -0.76), (-0.72, 0.76), (-0.5, 0.66), (-0.5, -0.66)], GLASS)
    _fill(canvas, half, [(0.16, -0.72), (0.16, 0.72), (-0.5, 0.68), (-0.5, -0.68)], (blue, green, red))
    across = ((np.arange(shape[0]) - (shape[0] - 1) / 2.0) / half[1]).clip(-1.0, 1.0)
    return np.asarray(canvas * (1.0 - 0.22 * across**4)[:, None, None], np.float32)


def _fill(
    canvas: ByteArray,
    half: FloatArray,
    corners: list[tuple[float, float]],
    colour: tuple[float, float, float],
) -> None:
    """Fills a polygon; corners are in units of half the length and half the width, px, about the centre."""
    points = np.array(corners) * half + (np.array(canvas.shape[1::-1]) - 1) / 2.0
    cv2.fillPoly(canvas, [np.rint(points * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
