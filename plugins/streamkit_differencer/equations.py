"""Equations 1 to 4 of the paper, in the reading that works, on whole images.

Three things differ from the print. Equation 1 leaves out the case of a pixel that stays quiet: its counter
stays 0. Equation 3 is meant for quiet pixels only. Equation 4 is printed the wrong way round and with the
background of the wrong time: foreground is what differs from the background as it was before this frame.

Masks are uint8, 255 for true. Brightness is uint8, the background float32: with 8 bits and a small
coefficient a difference of less than half a level per update would never be learnt.

Functions that take `scratch` return one of its planes, which holds until the function is called with it
again; without it they return an array of their own.

Source: Zhang, Liu, Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
section 2.2; the method is that of Collins et al., "A System for Video Surveillance and Monitoring", 2000.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.resampling import apart, parts
from streamkit_differencer.scratch import Scratch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Region = tuple[slice, slice]

# Grey levels that a pixel beside foreground must differ by at least, and how far from it that is looked at.
LEAST_WEAK = 5.0
GROWTH_STEPS = 2
# Largest lambda that a byte holds.
LONGEST_WAIT = 255
_SQUARE = np.ones((3, 3), np.uint8)
_NEIGHBOURHOOD = np.ones((5, 5), np.uint8)


def logical_matrix(
    current: ByteImage,
    earlier: ByteImage,
    threshold: float,
    *,
    gradient_gain: float = 0.0,
    ranges: ByteImage | None = None,
    scratch: Scratch | None = None,
) -> ByteImage:
    """Equation 2: whether a pixel changed since the frame tau before.

    Args:
        current: uint8[h, w], f(t).
        earlier: uint8[h, w], f(t - tau) on the same plane.
        threshold: T_s, grey levels; a change must exceed it.
        gradient_gain: raises the threshold by this share of the local range of `earlier`, so that an error
            of registration at an edge is not taken for a change; 0 is the equation as printed.
        ranges: uint8[h, w], the local range of `earlier` within 1 px, where that is known already.
        scratch: planes to work in.

    Returns:
        uint8[h, w], S(t) as a mask.
    """
    scratch = scratch or Scratch()
    difference = scratch.plane("logical", current.shape)
    cv2.absdiff(current, earlier, dst=difference)
    if gradient_gain > 0.0:
        if ranges is None:
            ranges = local_range(*local_bounds(earlier, 1, scratch), scratch)
        subtract_share(difference, ranges, gradient_gain, scratch)
    cv2.threshold(difference, threshold, 255, cv2.THRESH_BINARY, dst=difference)
    return difference


def dynamic_matrix(
    dynamic: ByteImage, logical: ByteImage, quiet_frames: int, *, scratch: Scratch | None = None
) -> ByteImage:
    """Equation 1: frames still to wait until a pixel counts as quiet.

    Args:
        dynamic: uint8[h, w], D(t - 1).
        logical: uint8[h, w], S(t) as a mask.
        quiet_frames: lambda, 1 to 255.
        scratch: planes to work in.

    Returns:
        uint8[h, w], D(t): lambda where the pixel changed, else one less than before, not below 0.
    """
    scratch = scratch or Scratch()
    # Where S = 1 the result is lambda, which is never less than D - 1: a maximum needs no branch.
    waiting = scratch.plane("waiting", dynamic.shape)
    changed = scratch.plane("changed", dynamic.shape)
    changed[:] = 1
    cv2.subtract(dynamic, changed, dst=waiting)
    cv2.threshold(logical, 0, quiet_frames, cv2.THRESH_BINARY, dst=changed)
    cv2.max(waiting, changed, dst=waiting)
    return waiting


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


def foreground(
    current: ByteImage,
    background: FloatImage | ByteImage,
    threshold: float | ByteImage,
    *,
    tolerance: int = 0,
    gradient_gain: float = 0.0,
    bounds: tuple[ByteImage, ByteImage] | None = None,
    scratch: Scratch | None = None,
) -> ByteImage:
    """Equation 4, corrected: whether a pixel differs from the background before this frame.

    Args:
        current: uint8[h, w], f(t).
        background: float32 or uint8[h, w], B(t - 1).
        threshold: T_F, grey levels; a difference must exceed it; uint8[h, w] gives each pixel its own.
        tolerance: error of registration to bear, px: a pixel is compared with the range of the background
            within this distance; 0 with a `gradient_gain` of 0 and one threshold is the equation itself.
        gradient_gain: raises the threshold by this share of that range.
        bounds: uint8[h, w] each, the ends of that range where they are known already.
        scratch: planes to work in.

    Returns:
        uint8[h, w], F(t) as a mask.
    """
    if tolerance == 0 and gradient_gain == 0.0 and not isinstance(threshold, np.ndarray):
        exact = cv2.absdiff(current.astype(np.float32), background.astype(np.float32, copy=False))
        return threshold_mask(cast("FloatImage", exact), threshold)
    scratch = scratch or Scratch()
    # With a tolerance the comparison is coarser than a grey level anyway, and 8 bits are four times as fast.
    rounded = cast("ByteImage", background)
    if background.dtype != np.uint8:
        rounded = cast("ByteImage", cv2.convertScaleAbs(background))
    excess = scratch.plane("excess", current.shape)
    if tolerance > 0 or gradient_gain > 0.0:
        lowest, highest = bounds or local_bounds(rounded, max(tolerance, 1), scratch)
    if tolerance > 0:
        below = scratch.plane("below", current.shape)
        cv2.subtract(current, highest, dst=excess)
        cv2.subtract(lowest, current, dst=below)
        cv2.max(excess, below, dst=excess)
    else:
        cv2.absdiff(current, rounded, dst=excess)
    if gradient_gain > 0.0:
        subtract_share(excess, local_range(lowest, highest, scratch), gradient_gain, scratch)
    if isinstance(threshold, np.ndarray):
        cv2.compare(excess, threshold, cv2.CMP_GT, dst=excess)
    else:
        cv2.threshold(excess, threshold, 255, cv2.THRESH_BINARY, dst=excess)
    return excess


def grown(
    mask: ByteImage,
    current: ByteImage,
    background: ByteImage,
    threshold: float | ByteImage,
    share: float,
    *,
    known: ByteImage | None = None,
    scratch: Scratch | None = None,
) -> tuple[ByteImage, list[Region]]:
    """The foreground and what is next to it and differs from the background by a share of the threshold.

    Args:
        mask: uint8[h, w], foreground.
        current: uint8[h, w], f(t).
        background: uint8[h, w], B(t - 1), rounded.
        threshold: T_F of all or of each pixel, grey levels.
        share: of the threshold, 0 to 1.
        known: uint8[h, w], mask of what may be foreground; None for everything.
        scratch: planes to work in.

    Returns:
        uint8[h, w]: the foreground without lone pixels, grown by up to `GROWTH_STEPS` times two pixels; and
        rectangles that hold all of it and do not overlap.

    Source: thresholding with hysteresis, Canny, "A Computational Approach to Edge Detection", PAMI 1986.
    """
    scratch = scratch or Scratch()
    result = scratch.plane("grown", mask.shape)
    cv2.medianBlur(mask, 3, dst=result)
    # Growth of a union is the union of the growths, so empty parts of the picture need no look.
    where = apart(parts(result), GROWTH_STEPS * (len(_NEIGHBOURHOOD) // 2), mask.shape)
    for part in where:
        piece = result[part]
        weak, near = scratch.plane("weak", piece.shape), scratch.plane("near", piece.shape)
        cv2.absdiff(current[part], background[part], dst=weak)
        if isinstance(threshold, np.ndarray):
            cv2.convertScaleAbs(threshold[part], dst=near, alpha=share)
            np.maximum(near, np.uint8(LEAST_WEAK), out=near)
            cv2.compare(weak, near, cv2.CMP_GT, dst=weak)
        else:
            cv2.threshold(weak, max(share * threshold, LEAST_WEAK), 255, cv2.THRESH_BINARY, dst=weak)
        cv2.bitwise_or(weak, piece, dst=weak)
        if known is not None:
            cv2.bitwise_and(weak, known[part], dst=weak)
        for _ in range(GROWTH_STEPS):
            cv2.dilate(piece, _NEIGHBOURHOOD, dst=near)
            cv2.bitwise_and(near, weak, dst=piece)
    return result, where


def local_bounds(
    image: ByteImage, radius: int, scratch: Scratch | None = None, name: str = "picture"
) -> tuple[ByteImage, ByteImage]:
    """The smallest and the largest value within a square of `radius` px around each pixel.

    Bounds of another name are in other planes of `scratch`.
    """
    scratch = scratch or Scratch()
    square = _SQUARE if radius == 1 else np.ones((2 * radius + 1,) * 2, np.uint8)
    lowest, highest = (
        scratch.plane(f"lowest of {name}", image.shape),
        scratch.plane(f"highest of {name}", image.shape),
    )
    cv2.erode(image, square, dst=lowest)
    cv2.dilate(image, square, dst=highest)
    return lowest, highest


def local_range(lowest: ByteImage, highest: ByteImage, scratch: Scratch) -> ByteImage:
    """The largest value around each pixel less the smallest one."""
    ranges = scratch.plane("range", lowest.shape)
    cv2.subtract(highest, lowest, dst=ranges)
    return ranges


def subtract_share(values: ByteImage, ranges: ByteImage, gain: float, scratch: Scratch) -> None:
    """Takes a share of the local range away from `values`."""
    share = scratch.plane("share", values.shape)
    cv2.convertScaleAbs(ranges, dst=share, alpha=gain)
    cv2.subtract(values, share, dst=values)


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
