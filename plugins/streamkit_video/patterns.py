"""Test images."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit import Choice

ByteArray = NDArray[np.uint8]
Colour = tuple[int, int, int]


class Pattern(Choice):
    """Content of a test image: GStreamer's words, numbers and labels."""

    SMPTE = "smpte", 0, "SMPTE 100% color bars"
    SNOW = "snow", 1, "Random (television snow)"
    BLACK = "black", 2, "100% Black"
    WHITE = "white", 3, "100% White"
    RED = "red", 4, "Red"
    GREEN = "green", 5, "Green"
    BLUE = "blue", 6, "Blue"
    CHECKERS_1 = "checkers-1", 7, "Checkers 1px"
    CHECKERS_2 = "checkers-2", 8, "Checkers 2px"
    CHECKERS_4 = "checkers-4", 9, "Checkers 4px"
    CHECKERS_8 = "checkers-8", 10, "Checkers 8px"
    CIRCULAR = "circular", 11, "Circular"
    BLINK = "blink", 12, "Blink"
    SMPTE75 = "smpte75", 13, "SMPTE 75% color bars"
    ZONE_PLATE = "zone-plate", 14, "Zone plate"
    SOLID_COLOR = "solid-color", 17, "Solid color"
    BALL = "ball", 18, "Moving ball"
    SMPTE100 = "smpte100", 19, "SMPTE 100% color bars"
    BAR = "bar", 20, "Bar"
    PINWHEEL = "pinwheel", 21, "Pinwheel"
    SPOKES = "spokes", 22, "Spokes"
    GRADIENT = "gradient", 23, "Gradient"
    COLORS = "colors", 24, "Colors"


MOVING = (Pattern.BALL, Pattern.SNOW, Pattern.BLINK)
CHECKER_SIDES = {
    Pattern.CHECKERS_1: 1, Pattern.CHECKERS_2: 2, Pattern.CHECKERS_4: 4, Pattern.CHECKERS_8: 8,
}  # fmt: skip
SOLID_COLOURS = {
    Pattern.BLACK: (0, 0, 0), Pattern.WHITE: (255, 255, 255), Pattern.RED: (0, 0, 255),
    Pattern.GREEN: (0, 255, 0), Pattern.BLUE: (255, 0, 0),
}  # fmt: skip
SPOKES = 16
BAR_PX = 7
# White, yellow, cyan, green, magenta, red, blue at 75 %, BGR.
BARS = ((191, 191, 191), (0, 191, 191), (191, 191, 0), (0, 191, 0), (191, 0, 191), (0, 0, 191), (191, 0, 0))
BLACK, WHITE = (19, 19, 19), (191, 191, 191)
REVERSE_BARS = ((191, 0, 0), BLACK, (191, 0, 191), BLACK, (191, 191, 0), BLACK, WHITE)
# -I, white, +Q, black, and the pluge (below black, black, above black); BGR.
PLUGE_BARS = ((76, 33, 0), (255, 255, 255), (106, 0, 50), (19, 19, 19), (9, 9, 9), (29, 29, 29), (19, 19, 19))
BALL_PERIODS = (200.0, 180.0)  # periods of the ball across and down, frames


def paint(
    pattern: Pattern,
    width: int,
    height: int,
    index: int,
    seed: int,
    colours: tuple[Colour, Colour] = (SOLID_COLOURS[Pattern.WHITE], SOLID_COLOURS[Pattern.BLACK]),
) -> ByteArray:
    """Paints a test image; the same arguments give the same image.

    Args:
        pattern: content.
        width: px.
        height: px.
        index: frame number; only the patterns in `MOVING` depend on it.
        seed: of snow.
        colours: foreground and background, BGR, of ball, blink, bar and solid-color.

    Returns:
        uint8[height, width, 3], BGR.
    """
    front, back = colours
    plain = {Pattern.BLINK: back if index % 2 else front, Pattern.SOLID_COLOR: front, **SOLID_COLOURS}
    image = np.full((height, width, 3), plain.get(pattern, back), np.uint8)
    if pattern in (Pattern.SMPTE, Pattern.SMPTE100, Pattern.SMPTE75):
        _paint_bars(image)
    elif pattern is Pattern.BALL:
        _paint_ball(image, index, front)
    elif pattern is Pattern.BAR:
        image[:, :BAR_PX] = front
    elif pattern is Pattern.COLORS:
        _paint_chart(image)
    elif pattern not in plain:
        image[:] = np.rint(_grey_levels(pattern, width, height, (seed, index)))[:, :, None]
    return image


def _grey_levels(pattern: Pattern, width: int, height: int, seed: tuple[int, int]) -> NDArray[Any]:
    """Patterns without colour, [height, width]."""
    if pattern is Pattern.SNOW:
        return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    if pattern is Pattern.GRADIENT:
        return np.broadcast_to(np.linspace(255.0, 0.0, height)[:, None], (height, width))
    if pattern in CHECKER_SIDES:
        rows, columns = (np.arange(length) // CHECKER_SIDES[pattern] for length in (height, width))
        return np.where((rows[:, None] + columns) % 2, 255, 0)
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height)[:, None] - (height - 1) / 2
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    if pattern is Pattern.CIRCULAR:
        return np.where((radius // 8) % 2 == 0, 255, 0)
    if pattern is Pattern.ZONE_PLATE:
        wave: NDArray[np.float64] = np.cos(np.pi * radius**2 / max(width, height))
        return 127.5 + 127.5 * wave
    turn = radius / 16 if pattern is Pattern.PINWHEEL else 0.0
    return np.where(np.sin(angle * SPOKES + turn) >= 0, 255, 0)


def _paint_chart(image: ByteArray) -> None:
    """A colour chart: red across, green down, blue in squares."""
    height, width = image.shape[:2]
    across, down = np.arange(width), np.arange(height)[:, None]
    image[:, :, 2] = across * 255 // max(1, width - 1)
    image[:, :, 1] = down * 255 // max(1, height - 1)
    image[:, :, 0] = (across // 16 + down // 16) * 32 % 256


def _paint_bars(image: ByteArray) -> None:
    """Colour bars in three bands of 8, 1 and 3 twelfths of the height, after SMPTE EG 1."""
    height, width = image.shape[:2]
    for first, last, colours in ((0, 8, BARS), (8, 9, REVERSE_BARS), (9, 12, PLUGE_BARS)):
        stripes = np.arange(width) * len(colours) // width
        image[height * first // 12 : height * last // 12] = np.array(colours, np.uint8)[stripes]


def _paint_ball(image: ByteArray, index: int, colour: Colour) -> None:
    """A ball that oscillates through the image."""
    size = np.array(image.shape[1::-1])
    radius = max(1, min(20, *(size // 4).tolist()))
    offsets = np.sin(2.0 * np.pi * index / np.array(BALL_PERIODS))
    x, y = (size - 1) / 2.0 + offsets * np.maximum(size / 2.0 - radius, 0.0)
    centre = (round(float(x) * 16), round(float(y) * 16))
    cv2.circle(image, centre, radius * 16, colour, -1, cv2.LINE_AA, 4)
