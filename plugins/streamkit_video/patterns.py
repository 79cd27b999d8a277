"""Test pictures."""

from __future__ import annotations

import enum

import cv2
import numpy as np
from numpy.typing import NDArray

ByteArray = NDArray[np.uint8]


class Pattern(enum.StrEnum):
    """What a test picture shows."""

    SMPTE = "smpte"
    BALL = "ball"
    SNOW = "snow"
    CHECKERS = "checkers"
    GRADIENT = "gradient"
    BLACK = "black"
    WHITE = "white"


MOVING = (Pattern.BALL, Pattern.SNOW)
BARS = ((191, 191, 191), (0, 191, 191), (191, 191, 0), (0, 191, 0), (191, 0, 191), (0, 0, 191), (191, 0, 0))
"""White, yellow, cyan, green, magenta, red, blue at 75 %, BGR."""
BLACK, WHITE = (19, 19, 19), (191, 191, 191)
REVERSED_BARS = ((191, 0, 0), BLACK, (191, 0, 191), BLACK, (191, 191, 0), BLACK, WHITE)
FOOT = ((76, 33, 0), (255, 255, 255), (106, 0, 50), (19, 19, 19), (9, 9, 9), (29, 29, 29), (19, 19, 19))
"""-I, white, +Q, black, and the pluge: blacker than black, black, brighter than black; BGR."""
CHECKER_SIDE = 8
BALL_PERIODS = (200.0, 180.0)
"""Frames of one swing of the ball across and down."""


def paint(pattern: Pattern, width: int, height: int, index: int, seed: int) -> ByteArray:
    """Paints a test picture: the same arguments, the same picture.

    Args:
        pattern: what to show.
        width: px.
        height: px.
        index: number of the frame; only the patterns in `MOVING` depend on it.
        seed: of the snow.

    Returns:
        uint8[height, width, 3], BGR.
    """
    if pattern is Pattern.SMPTE:
        return _bars(width, height)
    if pattern is Pattern.BALL:
        return _ball(width, height, index)
    if pattern is Pattern.SNOW:
        grey = np.random.default_rng((seed, index)).integers(0, 256, (height, width, 1), dtype=np.uint8)
        return np.repeat(grey, 3, axis=2)
    if pattern is Pattern.CHECKERS:
        rows, columns = np.arange(height) // CHECKER_SIDE, np.arange(width) // CHECKER_SIDE
        light = ((rows[:, None] + columns) % 2).astype(np.uint8)
        return np.repeat(light[:, :, None] * np.uint8(255), 3, axis=2)
    if pattern is Pattern.GRADIENT:
        ramp = np.rint(np.linspace(255.0, 0.0, height)).astype(np.uint8)
        return np.ascontiguousarray(np.broadcast_to(ramp[:, None, None], (height, width, 3)))
    return np.full((height, width, 3), 255 if pattern is Pattern.WHITE else 0, np.uint8)


def _bars(width: int, height: int) -> ByteArray:
    """Colour bars in three bands of 8, 1 and 3 twelfths of the height, after SMPTE EG 1."""
    picture = np.empty((height, width, 3), np.uint8)
    bands = ((0, height * 8 // 12, BARS), (height * 8 // 12, height * 9 // 12, REVERSED_BARS))
    for top, bottom, colours in (*bands, (height * 9 // 12, height, FOOT)):
        stripes = np.arange(width) * len(colours) // width
        picture[top:bottom] = np.array(colours, np.uint8)[stripes]
    return picture


def _ball(width: int, height: int, index: int) -> ByteArray:
    """A white ball on black that swings through the picture."""
    picture = np.zeros((height, width, 3), np.uint8)
    radius = max(1, min(20, width // 4, height // 4))
    swings = np.sin(2.0 * np.pi * index / np.array(BALL_PERIODS))
    room = np.array([width, height]) / 2.0 - radius
    x, y = np.array([width - 1, height - 1]) / 2.0 + swings * np.maximum(room, 0.0)
    centre = (round(float(x) * 16), round(float(y) * 16))
    return np.asarray(cv2.circle(picture, centre, radius * 16, (255, 255, 255), -1, cv2.LINE_AA, 4), np.uint8)
