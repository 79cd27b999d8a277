"""Equations 1 to 4 of the paper, on the part of the canvas that a frame covers, line by line.

Three points differ from the print. Equation 1 leaves out the case of a pixel that stays quiet: its counter
stays 0. Equation 3 is meant for quiet pixels only. Equation 4 is printed with its cases swapped and with the
background of the wrong time: foreground is what differs from the background as it was before this frame.

Masks are uint8, 255 where set. Brightness is uint8, the background float32: in 8 bits a difference of less
than half a level per update would never be learnt. A step for each image would take most of its time to read
and write them; a line stays in the processor's cache from one equation to the next.

Source: Zhang, Liu, Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
section 2.2; the method is that of Collins et al., "A System for Video Surveillance and Monitoring", 2000.
"""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import ByteLine, FloatLine
from streamkit_kernels import compiled

# Largest lambda. The counter D is kept as D + MAX_WAIT - lambda: a change sets it to this.
MAX_WAIT = 255
SET = np.uint8(255)


@compiled
def find_changes(image: ByteLine, earlier: ByteLine, threshold: np.uint8, changed: ByteLine) -> None:
    """Equation 2: the pixels that differ from f(t - tau) by more than T_s.

    Args:
        image: uint8[w], f(t).
        earlier: uint8[w], f(t - tau).
        threshold: T_s, whole grey levels; a change exceeds it.
        changed: uint8[w], becomes the mask S(t).
    """
    for index in range(changed.size):
        now, before = image[index], earlier[index]
        difference = np.uint8(max(now, before) - min(now, before))
        changed[index] = SET if difference > threshold else np.uint8(0)


@compiled
def count_down(waiting: ByteLine, changed: ByteLine) -> None:
    """Equation 1, in place: D = lambda where a pixel changed, else one less than before.

    Args:
        waiting: uint8[w], D(t - 1) + `MAX_WAIT` - lambda.
        changed: uint8[w], mask of what changed, S(t).
    """
    for index in range(waiting.size):
        left = waiting[index]
        waiting[index] = np.uint8(left - min(left, np.uint8(1))) | changed[index]


@compiled
def find_quiet(waiting: ByteLine, quiet_frames: int, quiet: ByteLine) -> None:
    """The pixels with D = 0 for this lambda; `quiet`, uint8[w], becomes their mask."""
    least = np.uint8(MAX_WAIT - quiet_frames)
    for index in range(waiting.size):
        quiet[index] = SET if waiting[index] <= least else np.uint8(0)


@compiled
def update_background(background: FloatLine, image: ByteLine, mask: ByteLine, rate: np.float32) -> None:
    """Equation 3, in place: B(t) = alpha f(t) + (1 - alpha) B(t - 1) where `mask` is set."""
    kept = np.float32(1.0) - rate
    for index in range(background.size):
        before = background[index]
        mixed = np.float32(image[index]) * rate + before * kept
        background[index] = mixed if mask[index] > 0 else before


@compiled
def find_foreground_pixels(
    image: ByteLine, background: ByteLine, thresholds: ByteLine, mask: ByteLine
) -> None:
    """Equation 4: the pixels that differ from B(t - 1) by more than their T_F.

    Args:
        image: uint8[w], f(t).
        background: uint8[w], B(t - 1) in whole grey levels.
        thresholds: uint8[w], T_F of each pixel.
        mask: uint8[w], becomes F(t).
    """
    for index in range(mask.size):
        value, known = image[index], background[index]
        difference = np.uint8(max(value, known) - min(value, known))
        mask[index] = SET if difference > thresholds[index] else np.uint8(0)
