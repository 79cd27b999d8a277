"""Sprites of cars seen from above, and drawing them into a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]

COLOURS = (
    (238, 240, 240), (24, 22, 22), (205, 206, 204), (92, 36, 22), (52, 205, 238),
    (28, 22, 112), (178, 212, 226), (44, 62, 20), (240, 228, 190), (40, 40, 44),
)  # fmt: skip
"""Paint, BGR: all differ from the brightness of the ground, which is near 115."""
GLASS = (46.0, 38.0, 32.0)
RESOLUTION = 2.0
"""Sprite px per frame px at mean altitude."""
OVERSAMPLING = 4
MARGIN = 4.0
BODY_BLUR = 0.7
SHADOW_BLUR = 1.6
SHADOW_STRENGTH = 0.5
SHADOW_OFFSET = (2.2, 3.0)
"""Offset of the shadow, frame px along the ground axes."""


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
    rows, columns = (
        OVERSAMPLING * int(np.ceil((side + 2 * MARGIN) * RESOLUTION)) for side in (width, length)
    )
    # Symmetric front and rear, so that the centre of the body is the centre of the silhouette.
    hull = [(0.87, 1), (1, 0.6), (1, -0.6), (0.87, -1), (-0.87, -1), (-1, -0.6), (-1, 0.6), (-0.87, 1)]
    silhouette = np.zeros((rows, columns, 3), np.uint8)
    _fill(silhouette, length, width, hull, (255.0, 255.0, 255.0))
    coverage = silhouette[:, :, :1].astype(np.float32) / 255.0
    lit = _lit_paint(rows, columns, length, width, colour)
    if channels == 1:
        lit = np.asarray(cv2.cvtColor(lit, cv2.COLOR_BGR2GRAY), np.float32)[:, :, None]
    small = (columns // OVERSAMPLING, rows // OVERSAMPLING)
    fine = np.concatenate([lit * coverage, coverage], axis=2)
    body = cv2.GaussianBlur(cv2.resize(fine, small, interpolation=cv2.INTER_AREA), (0, 0), BODY_BLUR)
    soft = cv2.GaussianBlur(cv2.resize(coverage, small, interpolation=cv2.INTER_AREA), (0, 0), SHADOW_BLUR)
    unit = scale / RESOLUTION
    local_from_sprite = np.array(
        [
            [unit, 0.0, -unit * (small[0] - 1) / 2.0],
            [0.0, unit, -unit * (small[1] - 1) / 2.0],
            [0.0, 0.0, 1.0],
        ]
    )
    return CarSprite(
        np.asarray(body, np.float32), np.asarray(SHADOW_STRENGTH * soft, np.float32), local_from_sprite
    )


def _lit_paint(
    rows: int, columns: int, length: float, width: float, colour: tuple[int, int, int]
) -> Float32Array:
    """float32[rows, columns, 3]: paint, a brighter roof between dark windows, darker sides."""
    canvas = np.empty((rows, columns, 3), np.uint8)
    canvas[:] = colour
    blue, green, red = (min(255.0, 1.12 * level + 8.0) for level in colour)
    _fill(canvas, length, width, [(0.48, -0.84), (0.48, 0.84), (0.16, 0.7), (0.16, -0.7)], GLASS)
    _fill(canvas, length, width, [(-0.72, -0.76), (-0.72, 0.76), (-0.5, 0.66), (-0.5, -0.66)], GLASS)
    roof = [(0.16, -0.72), (0.16, 0.72), (-0.5, 0.68), (-0.5, -0.68)]
    _fill(canvas, length, width, roof, (blue, green, red))
    half_width = width / 2.0 * RESOLUTION * OVERSAMPLING
    across = ((np.arange(rows) - (rows - 1) / 2.0) / half_width).clip(-1.0, 1.0)
    return np.asarray(canvas * (1.0 - 0.22 * across**4)[:, None, None], np.float32)


def _fill(
    canvas: ByteArray,
    length: float,
    width: float,
    corners: list[tuple[float, float]],
    colour: tuple[float, float, float],
) -> None:
    """Fills a polygon; corners are in units of half the length and half the width, about the centre."""
    middle = ((canvas.shape[1] - 1) / 2.0, (canvas.shape[0] - 1) / 2.0)
    points = np.array(corners) * (length / 2.0, width / 2.0) * RESOLUTION * OVERSAMPLING + middle
    cv2.fillPoly(canvas, [np.rint(points * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)


def draw_shadow(image: ByteArray, sprite: CarSprite, frame_from_local: FloatArray) -> None:
    """Draws a car's shadow into an image, uint8[h, w] or [h, w, 3], in place."""
    warped = _warped(sprite.shadow, sprite, frame_from_local, image.shape)
    if warped is not None:
        part, dark = image[warped[0]], warped[1]
        light = 1.0 - (dark if image.ndim == 2 else dark[:, :, None])
        part[...] = np.rint(part * light)


def draw_body(image: ByteArray, sprite: CarSprite, frame_from_local: FloatArray) -> None:
    """Draws a car into an image, uint8[h, w] or [h, w, 3], in place."""
    warped = _warped(sprite.body, sprite, frame_from_local, image.shape)
    if warped is not None:
        part, layers = image[warped[0]], warped[1]
        behind = 1.0 - layers[:, :, -1:]
        colour = layers[:, :, :-1]
        if image.ndim == 2:
            behind, colour = behind[:, :, 0], colour[:, :, 0]
        part[...] = np.rint(part * behind + colour)


def _warped(
    layers: Float32Array, sprite: CarSprite, frame_from_local: FloatArray, shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], Float32Array] | None:
    """The region of the frame that a sprite covers and the warped sprite; None outside the frame."""
    frame_from_sprite = frame_from_local @ sprite.local_from_sprite
    left, top, right, bottom = _bounds(frame_from_sprite, layers.shape[1], layers.shape[0])
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, shape[1]), min(bottom, shape[0])
    if right <= left or bottom <= top:
        return None
    frame_from_sprite[0] -= left * frame_from_sprite[2]
    frame_from_sprite[1] -= top * frame_from_sprite[2]
    size = (right - left, bottom - top)
    warped = cv2.warpPerspective(layers, frame_from_sprite, size, flags=cv2.INTER_LINEAR)
    return (slice(top, bottom), slice(left, right)), np.asarray(warped, np.float32)


def _bounds(homography: FloatArray, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a projected sprite; plain Python, as numpy is slow on four points."""
    across, down, depth = homography.tolist()
    xs, ys = [], []
    for x, y in ((-1, -1), (columns, -1), (columns, rows), (-1, rows)):
        divisor = depth[0] * x + depth[1] * y + depth[2]
        xs.append((across[0] * x + across[1] * y + across[2]) / divisor)
        ys.append((down[0] * x + down[1] * y + down[2]) / divisor)
    return math.floor(min(xs)), math.floor(min(ys)), math.ceil(max(xs)) + 1, math.ceil(max(ys)) + 1
