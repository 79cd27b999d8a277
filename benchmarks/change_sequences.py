"""Sequences of changedetection.net's form with their truth, and its score.

Needs numpy and OpenCV only, so that peers can read it from an environment of their own.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

ByteImage = npt.NDArray[np.uint8]
SHARED = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data" / "change"
SHAKE_PX, SHAKE_DEGREES, SHAKE_SEED = 3.0, 0.3, 0
FOREGROUND = 100
MOVING, OUTSIDE, UNKNOWN = 255, 85, 170


@dataclass(frozen=True, eq=False)
class Sequence:
    """Frames with their truth.

    Attributes:
        name: of the folder, with `shaken` behind it where the frames are moved.
        frames: uint8[h, w, 3] each, BGR.
        truths: uint8[h, w] each; None where a frame is not scored.
        region: bool[h, w], where it is scored.
    """

    name: str
    frames: list[ByteImage]
    truths: list[ByteImage | None]
    region: npt.NDArray[np.bool_]

    @classmethod
    def read(cls, folder: Path) -> Sequence:
        """A folder as changedetection.net publishes it."""
        paths = sorted((folder / "input").iterdir())
        numbers = [int("".join(filter(str.isdigit, path.stem))) for path in paths]
        roi, span = folder / "ROI.bmp", folder / "temporalROI.txt"
        first, last = map(int, span.read_text().split()) if span.exists() else (0, max(numbers))
        frames = [cv2.imread(str(path)) for path in paths]
        truths = []
        for number in numbers:
            path = folder / "groundtruth" / f"gt{number:06d}.png"
            truths.append(cv2.imread(str(path), 0) if first <= number <= last and path.exists() else None)
        everywhere = np.ones(frames[0].shape[:2], np.bool_)
        region = cv2.imread(str(roi), 0) > 0 if roi.exists() else everywhere
        return cls(folder.name, frames, truths, region if region.shape == everywhere.shape else everywhere)

    def shaken(self) -> Sequence:
        """The same seen by a camera that shakes; unscored where the truth leaves the frame."""
        random, state = np.random.default_rng(SHAKE_SEED), np.zeros(3)
        frames, truths = [], []
        for frame, truth in zip(self.frames, self.truths, strict=True):
            state = 0.8 * state + 0.6 * random.normal(0, [SHAKE_PX, SHAKE_PX, SHAKE_DEGREES])
            height, width = frame.shape[:2]
            matrix = cv2.getRotationMatrix2D((width / 2, height / 2), state[2], 1)
            matrix[:, 2] += state[:2]
            size = width, height
            border = cv2.BORDER_REFLECT
            frames.append(cv2.warpAffine(frame, matrix, size, flags=cv2.INTER_CUBIC, borderMode=border))
            nearest = cv2.INTER_NEAREST
            truths.append(
                None
                if truth is None
                else cv2.warpAffine(truth, matrix, size, flags=nearest, borderValue=OUTSIDE)
            )
        return Sequence(f"{self.name} shaken", frames, truths, self.region)


@dataclass
class Score:
    """Counts of pixels that are found and true, found and false, missed."""

    found: int = 0
    false: int = 0
    missed: int = 0

    def add(self, mask: ByteImage, truth: ByteImage, region: npt.NDArray[np.bool_]) -> None:
        """Adds a frame."""
        judged = region & (truth != OUTSIDE) & (truth != UNKNOWN)
        found, true = (mask > FOREGROUND) & judged, (truth == MOVING) & judged
        self.found += np.count_nonzero(found & true)
        self.false += np.count_nonzero(found & ~true)
        self.missed += np.count_nonzero(~found & true)

    @property
    def f_measure(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.found / max(1, 2 * self.found + self.false + self.missed)

    @property
    def precision(self) -> float:
        """Share of what is found that is true."""
        return self.found / max(1, self.found + self.false)

    @property
    def recall(self) -> float:
        """Share of what is true that is found."""
        return self.found / max(1, self.found + self.missed)
