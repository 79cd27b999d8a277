"""Drawing on BGR images; every function writes into the given array and clips at its borders."""

from __future__ import annotations

import colorsys
import enum
import itertools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

ByteArray = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]
Rectangle = tuple[int, int, int, int]

SHIFT = 4  # fractional bits of the coordinates given to OpenCV
# Coordinates are clipped to this many px: OpenCV's fixed-point numbers overflow beyond.
MAX_COORDINATE = 1 << 20
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
DASH = 6.0
GAP = 6.0
MIN_SIDE = 6.0
FONT = cv2.FONT_HERSHEY_SIMPLEX
LABEL_SCALE = 0.5
BORDER_OFFSETS = ((-1, 0), (1, 0), (0, -1), (0, 1))
DETECTION_COLOUR: Colour = (200, 200, 200)
CIRCLE: FloatArray = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0.0, math.tau, 33)[:-1]])
BLACK: Colour = (0, 0, 0)
WHITE: Colour = (255, 255, 255)


LineStyle = enum.StrEnum("LineStyle", "SOLID DASHED THIN")


def identity_colour(identity: int) -> Colour:
    """A bright colour for an id, BGR; consecutive ids have distant hues."""
    red, green, blue = colorsys.hsv_to_rgb((identity * GOLDEN) % 1.0, 0.75, 1.0)
    return round(255 * blue), round(255 * green), round(255 * red)


def box_corners(x: float, y: float, length: float, width: float, angle: float) -> FloatArray:
    """float64[4, 2]: the corners of a rotated box in order around it, front right first, px.

    x, y is its centre; the length is along `angle`, rad from +x towards +y; sides are at least `MIN_SIDE`.
    """
    along = np.array([math.cos(angle), math.sin(angle)]) * max(length, MIN_SIDE) / 2.0
    across = np.array([-math.sin(angle), math.cos(angle)]) * max(width, MIN_SIDE) / 2.0
    corners = np.array([along + across, along - across, -along - across, -along + across])
    return np.asarray(corners + np.array([x, y]), np.float64)


def ellipse_points(x: float, y: float, covariance: FloatArray, deviations: float) -> FloatArray:
    """float64[32, 2]: points on a confidence ellipse around x, y, px; NaN for an unknown covariance.

    The covariance is float64[2, 2], px squared; `deviations` is the size in standard deviations.
    """
    if not np.isfinite(covariance).all():
        return np.full((len(CIRCLE), 2), np.nan)
    variances, axes = np.linalg.eigh((covariance + covariance.T) / 2.0)
    radii = deviations * np.sqrt(variances.clip(0.0))
    return np.asarray(np.array([x, y]) + (CIRCLE * radii) @ axes.T, np.float64)


def draw_outline(image: ByteArray, corners: FloatArray, colour: Colour, style: LineStyle) -> None:
    """Draws a closed outline through float64[n, 2] px; solid and dashed are 2 px wide, thin is 1 px."""
    if not np.isfinite(corners).all():
        return
    if style is LineStyle.DASHED:
        dashes = [_fixed_point(dash) for dash in _dashes(np.vstack([corners, corners[:1]]))]
        cv2.polylines(image, dashes, False, colour, 2, cv2.LINE_AA, SHIFT)
        return
    thickness = 1 if style is LineStyle.THIN else 2
    cv2.polylines(image, [_fixed_point(corners)], True, colour, thickness, cv2.LINE_AA, SHIFT)


def draw_trail(image: ByteArray, points: FloatArray, colour: Colour) -> None:
    """Draws a trail, float64[n, 2] px, oldest first; the older half is thin."""
    points = points[np.isfinite(points).all(axis=1)]
    middle = len(points) // 2
    for part, thickness in ((points[: middle + 1], 1), (points[middle:], 2)):
        if len(part) > 1:
            cv2.polylines(image, [_fixed_point(part)], False, colour, thickness, cv2.LINE_AA, SHIFT)


def draw_label(
    image: ByteArray, text: str, corners: FloatArray, colour: Colour, others: list[Rectangle]
) -> None:
    """Writes text at a corner of an outline, in its colour with a dark border.

    It is the first of upper right, upper left, lower right, lower left where the text is inside the image and
    covers no other label; upper right if none is.

    Args:
        image: uint8[height, width, 3], BGR.
        text: a few characters.
        corners: float64[n, 2], of the outline, px.
        colour: BGR.
        others: left, top, right and bottom of the labels drawn so far, px; this one is added.
    """
    if not np.isfinite(corners).all():
        return
    limit = float(max(image.shape[:2]))
    left, top = (round(float(side)) for side in np.clip(corners.min(axis=0), -limit, 2.0 * limit))
    right, bottom = (round(float(side)) for side in np.clip(corners.max(axis=0), -limit, 2.0 * limit))
    (width, height), _ = cv2.getTextSize(text, FONT, LABEL_SCALE, 1)
    places = [(x, y) for y in (top - 2, bottom + 2 + height) for x in (right + 2, left - 2 - width)]
    rectangles = [(x, y - height, x + width, y) for x, y in places]
    chosen = next((area for area in rectangles if _is_free(area, image, others)), rectangles[0])
    others.append(chosen)
    x, y = chosen[0], chosen[3]
    # Not one thicker black text below: OpenCV's letters get wider as they get thicker.
    for right_px, down_px in BORDER_OFFSETS:
        cv2.putText(image, text, (x + right_px, y + down_px), FONT, LABEL_SCALE, BLACK, 1, cv2.LINE_AA)
    cv2.putText(image, text, (x, y), FONT, LABEL_SCALE, colour, 1, cv2.LINE_AA)


def _is_free(area: Rectangle, image: ByteArray, others: list[Rectangle]) -> bool:
    left, top, right, bottom = area
    is_inside = min(left, top) >= 0 and right <= image.shape[1] and bottom <= image.shape[0]
    return is_inside and not any(
        left < other[2] and other[0] < right and top < other[3] and other[1] < bottom for other in others
    )


def draw_status(image: ByteArray, text: str) -> None:
    """Writes a line of text on a darkened strip in the upper left corner."""
    size = min(max(image.shape[0] / 1300.0, 0.35), 1.2)  # scale of OpenCV's font
    (width, height), below = cv2.getTextSize(text, FONT, size, 1)
    margin = max(3, height // 2)
    strip = image[: height + below + margin, : width + 2 * margin]
    strip //= 3
    cv2.putText(image, text, (margin, height + margin // 2 + 1), FONT, size, WHITE, 1, cv2.LINE_AA)


def _fixed_point(points: FloatArray) -> NDArray[np.int32]:
    scaled = np.rint(points.clip(-MAX_COORDINATE, MAX_COORDINATE) * (1 << SHIFT))
    return np.asarray(scaled, np.int32)


def _dashes(path: FloatArray) -> list[FloatArray]:
    """The dashes of a path; a segment shorter than a dash, or of 4096 px and more, is one line."""
    pieces: list[FloatArray] = []
    for begin, end in itertools.pairwise(path):
        length = float(np.hypot(*(end - begin)))
        if not DASH < length < 4096.0:
            pieces.append(np.array([begin, end]))
            continue
        count = max(2, round((length + GAP) / (DASH + GAP)))
        stride = (length + GAP) / count
        for number in range(count):
            shares = np.array([[number * stride], [number * stride + stride - GAP]]) / length
            pieces.append(begin + shares * (end - begin))
    return pieces
