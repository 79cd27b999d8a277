"""Noise of each pixel of the background, the unit of equation 4's threshold.

A road is quiet, leaves are not, and an edge with a registration error flickers: one threshold for all pixels
is too high for the first or too low for the others. At a low rate a codec repeats what hardly changes, and
shows it a few grey levels off when it codes it anew: such a pixel is not as quiet as it seems.
"""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import ByteLine
from streamkit_differencer.ground import DEVIATION_STEPS, PROVISIONAL
from streamkit_kernels import compiled

MAX_THRESHOLD = 60
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# First mean deviation of a pixel, and the share of the local range that is added: edges may flicker.
FIRST_DEVIATION, EDGE_SHARE = np.float32(1.5), np.float32(0.04)
# Weight of a frame in a pixel's noise, and in that of a pixel that was never quiet.
LEARNING_RATE, RESTLESS_RATE = 0.1, 0.15
# Eight pixels in a row that stay exactly the same are repeated; noise leaves a quarter of single ones so.
REPEATED_PX = 8
# Where more of a frame is foreground, what passes for background may be part of what moves.
MAX_FOREGROUND = 0.3


@compiled
def find_thresholds(deviation: ByteLine, gain: np.float32, lowest: np.float32, thresholds: ByteLine) -> None:
    """T_F of each pixel of a line: so many mean deviations, but not below `lowest` grey levels."""
    highest, share = np.float32(MAX_THRESHOLD), gain / np.float32(DEVIATION_STEPS)
    for index in range(thresholds.size):
        wanted = min(np.rint(np.float32(deviation[index]) * share), highest)
        thresholds[index] = np.uint8(np.int32(max(wanted, lowest)))


@compiled
def find_measured(image: ByteLine, last: ByteLine, measured: ByteLine) -> None:
    """The pixels of a line that show noise: blocks that a codec repeats show none until it codes them anew.

    Args:
        image: uint8[w], f(t).
        last: uint8[w], f(t - 1).
        measured: uint8[w], becomes above 0 in the groups of `REPEATED_PX` of which a pixel changed; what is
            left over at the end is a group.
    """
    whole = image.size // REPEATED_PX * REPEATED_PX
    for first in range(0, whole, REPEATED_PX):
        changes = np.uint8(0)
        for index in range(REPEATED_PX):
            changes |= image[first + index] ^ last[first + index]
        for index in range(REPEATED_PX):
            measured[first + index] = changes
    changes = np.uint8(0)
    for index in range(whole, image.size):
        changes |= image[index] ^ last[index]
    measured[whole:] = changes


@compiled
def learn_noise(
    image: ByteLine,
    background: ByteLine,
    measured: ByteLine,
    averaged: ByteLine,
    mask: ByteLine,
    valid: ByteLine,
    rates: tuple[np.float32, np.float32],
    deviation: ByteLine,
) -> None:
    """Learns the mean absolute deviation of each pixel of a line as a running mean.

    Args:
        image: uint8[w], f(t).
        background: uint8[w], B(t - 1) in whole grey levels.
        measured: uint8[w], see `find_measured`.
        averaged: uint8[w], mask of known background at rest.
        mask: uint8[w], foreground.
        valid: uint8[w], see `ground`.
        rates: weight of the frame in the noise of `averaged`, and in that of a provisional background.
        deviation: uint8[w], see `ground`; updated in place.
    """
    (rate, restless_rate), steps = rates, np.float32(DEVIATION_STEPS)
    for index in range(deviation.size):
        value, other = image[index], background[index]
        difference = steps * np.float32(np.uint8(max(value, other) - min(value, other)))
        is_restless = (valid[index] == np.uint8(PROVISIONAL)) & (mask[index] == np.uint8(0))
        weight = rate if averaged[index] > 0 else (restless_rate if is_restless else np.float32(0.0))
        weight = weight if measured[index] > 0 else np.float32(0.0)
        mean = difference * weight + np.float32(deviation[index]) * (np.float32(1.0) - weight)
        deviation[index] = np.uint8(np.int32(min(np.rint(mean), np.float32(255.0))))
