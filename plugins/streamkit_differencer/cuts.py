"""Cuts: another scene from one frame to the next, between two calm stretches of frames.

Frames are compared tile by tile by the correlation of small means. Movers change some tiles, gain and offset
change none, and noise hardly changes means. Scenes that always change, such as leaves in the wind before the
camera, are never calm, and a single broken frame is followed by the old scene.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray

# Tiles along each side, means along each side of a tile, and pixels along each side of a mean.
TILES, MEANS, MEAN_PX = 4, 6, 8
# Correlation below which two tiles are unlike; tiles of a smaller standard deviation are compared by their
# means.
MIN_CORRELATION = 0.5
MIN_TEXTURE = 8.0
NEAR = 10.0
# Largest share of unlike tiles between two frames of a calm stretch, and frames of it before a cut and behind
# it.
CALM_SHARE = 0.3
CALM_FRAMES = 8
CUT_FRAMES = 3
# A frame without texture may be a lens that is covered for a moment.
COVERED_FRAMES = 75


class Cut(enum.Enum):
    """What a frame shows: the known scene, perhaps another one, or another one for sure."""

    NONE = enum.auto()
    SUSPECTED = enum.auto()
    CONFIRMED = enum.auto()


@dataclass(slots=True)
class CutDetector:
    """Compares each frame with the one before it and, after a jump, with the last one before the jump."""

    _known: FloatArray | None = None
    _last: FloatArray | None = None
    _calm: int = 0
    _unlike: int = 0

    def reset(self) -> None:
        """Starts again with the next frame."""
        self._known = self._last = None
        self._calm = self._unlike = 0

    def update(self, image: ByteImage, share: float) -> Cut:
        """Judges a frame.

        Args:
            image: uint8[h, w], all of one size until `reset`.
            share: of tiles that must be unlike for a cut, 0 to 1; less in the frames that confirm it.
        """
        tiles = tiles_of(image)
        if self._known is None or self._last is None:
            self._known = self._last = tiles
            return Cut.NONE
        change = unlike_share(self._last, tiles)
        is_calm = change <= CALM_SHARE
        if self._unlike == 0:
            is_other = self._calm >= CALM_FRAMES and change >= share
        else:
            # Movers make a tile of the new scene like the old one by chance: hysteresis.
            is_other = is_calm and unlike_share(self._known, tiles) >= (share + CALM_SHARE) / 2
        self._last = tiles
        if is_other:
            self._unlike += 1
            limit = CUT_FRAMES if np.median(tiles.std(axis=1)) >= MIN_TEXTURE else COVERED_FRAMES
            if self._unlike < limit:
                return Cut.SUSPECTED
            # The camera may be switched back at once.
            self._known, self._calm, self._unlike = tiles, CALM_FRAMES, 0
            return Cut.CONFIRMED
        self._calm = self._calm + 1 if is_calm else 0
        self._known, self._unlike = tiles, 0
        return Cut.NONE


def tiles_of(image: ByteImage) -> FloatArray:
    """Means of parts of an image, float64[tiles, means]; parts of a small image are smaller.

    A remainder at the right and bottom is left out.
    """
    step = int(np.clip(min(image.shape) // (TILES * MEANS), 1, MEAN_PX))
    rows, columns = (max(1, length // (TILES * step)) for length in image.shape)
    # Whole pixels per mean are several times as fast.
    whole = image[: rows * TILES * step, : columns * TILES * step]
    means = cv2.resize(whole, (columns * TILES, rows * TILES), interpolation=cv2.INTER_AREA)
    tiles = means.astype(np.float64).reshape(TILES, rows, TILES, columns).swapaxes(1, 2)
    return tiles.reshape(TILES * TILES, rows * columns)


def unlike_share(first: FloatArray, second: FloatArray) -> float:
    """Share of the tiles that do not correlate, or that are without texture and differ in brightness."""
    means, deviations = [], []
    for tiles in (first, second):
        means.append(tiles.mean(axis=1))
        deviations.append(tiles.std(axis=1))
    covariance = ((first - means[0][:, None]) * (second - means[1][:, None])).mean(axis=1)
    is_plain = np.maximum(*deviations) < MIN_TEXTURE
    # The whole frame may be brighter.
    step = means[1] - means[0]
    differs = np.abs(step - np.median(step)) > NEAR
    unlike = np.where(is_plain, differs, covariance < MIN_CORRELATION * deviations[0] * deviations[1])
    # Objects on plain ground leave most of it as it was.
    changes = np.median(np.abs(second - first), axis=1) > NEAR
    becomes_plain = ~is_plain & (np.minimum(*deviations) < MIN_CORRELATION * MIN_TEXTURE)
    return float(np.mean(np.where(becomes_plain, changes, unlike)))
