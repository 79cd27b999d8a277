"""Patches of a keyframe, prepared for joint alignment."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_stitcher.registration.gauss_newton import Scaling
from streamkit_stitcher.registration.patches import PatchLevel, prepare


@dataclass(frozen=True, eq=False)
class JointLevel:
    """Patches of one pyramid level, in an order whose every leading part covers the whole frame.

    Attributes:
        patches: the patches.
        numbers: int64[n], their numbers in the keyframe.
        scaling: of their centres.
    """

    patches: PatchLevel
    numbers: npt.NDArray[np.int64]
    scaling: Scaling

    def without(self, left_out: MaskArray) -> "JointLevel":
        """Marks patches as not usable, bool[n]."""
        return replace(self, patches=replace(self.patches, usable=self.patches.usable & ~left_out))

    def part(self, chosen: npt.NDArray[np.int64]) -> "JointLevel":
        """Some of the patches, by their indices."""
        return JointLevel(self.patches.part(chosen), self.numbers[chosen], self.scaling)


def spread_order(count: int) -> npt.NDArray[np.int64]:
    """The numbers below `count`, each leading part evenly spread, int64[count].

    Source: van der Corput, Verteilungsfunktionen, 1935.
    """
    numbers, reversed_bits = np.arange(count), np.zeros(count, dtype=np.int64)
    for bit in range(max(1, count - 1).bit_length()):
        reversed_bits = reversed_bits << 1 | numbers >> bit & 1
    return np.argsort(reversed_bits, kind="stable")


def joint_level(patches: GreyArray, centres: FloatArray, numbers: npt.NDArray[np.int64]) -> JointLevel:
    """Prepares patches for any number of alignments.

    Args:
        patches: uint8[n, 17, 17] from `cut_patches`, n >= 1.
        centres: float64[n, 2], px of the level.
        numbers: int64[n], their numbers in the keyframe.
    """
    return JointLevel(prepare(patches, centres), numbers, Scaling.of(centres))
