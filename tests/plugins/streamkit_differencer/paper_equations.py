"""Equations 1 to 4 of the paper, in the reading that works, on whole images.

Three points differ from the print. Equation 1 leaves out the case of a pixel that stays quiet: its counter
stays 0. Equation 3 is meant for quiet pixels only. Equation 4 is printed the wrong way round and with the
background of the wrong time: foreground is what differs from the background as it was before this frame.

Masks are uint8, 255 for true. Brightness is uint8, the background float32: with 8 bits and a small
coefficient a difference of less than half a level per update would never be learnt.

The model on the moving canvas (`streamkit_differencer.model`) extends them in kernels of its own: `changes`,
`pixel_classes` and `learning`.

Source: Zhang, Liu, Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
section 2.2; the method is that of Collins et al., "A System for Video Surveillance and Monitoring", 2000.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]


def logical_matrix(current: ByteImage, earlier: ByteImage, threshold: float) -> ByteImage:
    """Equation 2: whether a pixel changed since the frame tau before.

    Args:
        current: uint8[h, w], f(t).
        earlier: uint8[h, w], f(t - tau) on the same plane.
        threshold: T_s, grey levels; a change must exceed it.

    Returns:
        uint8[h, w], S(t) as a mask.
    """
    return threshold_mask(cast("ByteImage", cv2.absdiff(current, earlier)), threshold)


def dynamic_matrix(dynamic: ByteImage, logical: ByteImage, quiet_frames: int) -> ByteImage:
    """Equation 1: frames still to wait until a pixel counts as quiet.

    Args:
        dynamic: uint8[h, w], D(t - 1).
        logical: uint8[h, w], S(t) as a mask.
        quiet_frames: lambda, 1 to 255.

    Returns:
        uint8[h, w], D(t): lambda where the pixel changed, else one less than before, not below 0.
    """
    # Where S = 1 the result is lambda, which is never less than D - 1: a maximum needs no branch.
    waiting = cv2.subtract(dynamic, np.ones_like(dynamic))
    changed = cv2.threshold(logical, 0, quiet_frames, cv2.THRESH_BINARY)[1]
    return cast("ByteImage", cv2.max(waiting, changed))


def update_background(
    background: FloatImage, current: ByteImage, mask: ByteImage, coefficient: float
) -> None:
    """Equation 3, in place: B(t) = alpha f(t) + (1 - alpha) B(t - 1) where `mask` is set.

    Args:
        background: float32[h, w], B(t - 1), becomes B(t).
        current: uint8[h, w], f(t).
        mask: uint8[h, w], the pixels to update: those with D(t) = 0.
        coefficient: alpha, 0 to 1.
    """
    cv2.accumulateWeighted(current, background, coefficient, mask=mask)


def foreground(current: ByteImage, background: FloatImage, threshold: float) -> ByteImage:
    """Equation 4, corrected: whether a pixel differs from the background before this frame.

    Args:
        current: uint8[h, w], f(t).
        background: float32[h, w], B(t - 1).
        threshold: T_F, grey levels; a difference must exceed it.

    Returns:
        uint8[h, w], F(t) as a mask.
    """
    difference = cv2.absdiff(current.astype(np.float32), background)
    return threshold_mask(cast("FloatImage", difference), threshold)


def quiet_mask(dynamic: ByteImage) -> ByteImage:
    """uint8[h, w]: 255 where D = 0, that is where equation 3 applies."""
    return cast("ByteImage", cv2.threshold(dynamic, 0, 255, cv2.THRESH_BINARY_INV)[1])


def threshold_mask(image: ByteImage | FloatImage, threshold: float) -> ByteImage:
    """uint8[h, w]: 255 where the image exceeds the threshold."""
    return cv2.threshold(image, threshold, 255, cv2.THRESH_BINARY)[1].astype(np.uint8, copy=False)


@dataclass(slots=True)
class FrameDifference:
    """Equations 1 to 4 for a camera that does not move, and nothing else.

    A pixel's background is valid only from the first time that the pixel was quiet for `quiet_frames`;
    before that there is no foreground. Taking the first frame for background instead would leave a ghost of
    everything that moved in it.

    Attributes:
        interval: tau, frames.
        quiet_frames: lambda, frames.
        change_threshold: T_s, grey levels.
        foreground_threshold: T_F, grey levels.
        coefficient: alpha.
        dynamic: uint8[h, w], D(t); None before the first frame.
        background: float32[h, w], B(t); None before the first frame.
        valid: uint8[h, w], mask of the pixels whose background is known.
    """

    interval: int = 3
    quiet_frames: int = 12
    change_threshold: float = 18.0
    foreground_threshold: float = 22.0
    coefficient: float = 0.08
    dynamic: ByteImage | None = None
    background: FloatImage | None = None
    valid: ByteImage | None = None
    _earlier: list[ByteImage] = field(default_factory=list)

    def update(self, current: ByteImage) -> ByteImage:
        """Takes in one frame, uint8[h, w], and returns its foreground, uint8[h, w] as a mask."""
        if self.dynamic is None or self.background is None or self.valid is None:
            self.dynamic = np.full(current.shape, self.quiet_frames, np.uint8)
            self.background = np.zeros(current.shape, np.float32)
            self.valid = np.zeros(current.shape, np.uint8)
        mask = foreground(current, self.background, self.foreground_threshold) & self.valid
        if len(self._earlier) == self.interval:
            logical = logical_matrix(current, self._earlier.pop(0), self.change_threshold)
            self.dynamic = dynamic_matrix(self.dynamic, logical, self.quiet_frames)
        quiet = quiet_mask(self.dynamic)
        cv2.copyTo(current.astype(np.float32), quiet & ~self.valid, self.background)
        update_background(self.background, current, quiet, self.coefficient)
        self.valid |= quiet
        self._earlier.append(current.copy())
        return mask
