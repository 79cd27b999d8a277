"""Patches of a key picture in an order of their own, and the homography that suits their shifts best."""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_stitcher.homographies import IDENTITY, FloatArray, GreyArray, MaskArray
from streamkit_stitcher.registration.gauss_newton import Scaling, monomials
from streamkit_stitcher.registration.patches import PatchLevel, prepare

# How the eight parameters of a homography near the identity move a point in x and in y, by its monomials.
ACROSS: Final[FloatArray] = np.zeros((8, 6))
ACROSS[[0, 1, 2, 6, 7], [3, 4, 5, 0, 1]] = 1, 1, 1, -1, -1
DOWN: Final[FloatArray] = np.zeros((8, 6))
DOWN[[3, 4, 5, 6, 7], [3, 4, 5, 1, 2]] = 1, 1, 1, -1, -1
_MOVES: Final[FloatArray] = np.concatenate([ACROSS.T, DOWN.T])
# The normal equations' sides by the moments of the monomials, all at once: thrice as fast as term by term.
_NORMAL_OF_ONE: Final[FloatArray] = np.kron(ACROSS, ACROSS) + np.kron(DOWN, DOWN)
_NORMAL_OF_THREE: Final[FloatArray] = np.hstack(
    [
        np.kron(ACROSS, ACROSS),
        np.kron(ACROSS, DOWN) + np.kron(DOWN, ACROSS),
        np.kron(DOWN, DOWN),
    ]
)
_WANTED_OF_ONE: Final[FloatArray] = np.stack([ACROSS, DOWN], axis=2).reshape(8, 12)
_WANTED_OF_THREE: Final[FloatArray] = np.hstack(
    [
        np.stack([ACROSS, np.zeros((8, 6))], axis=2).reshape(8, 12),
        np.stack([DOWN, ACROSS], axis=2).reshape(8, 12),
        np.stack([np.zeros((8, 6)), DOWN], axis=2).reshape(8, 12),
    ]
)


@dataclass(frozen=True, eq=False)
class JointLevel:
    """Patches of one pyramid level, each leading part of them spread over the whole picture.

    Attributes:
        patches: the patches.
        numbers: int64[n], which of the key picture's they are.
        scaling: of their centres.
        powers: float64[6, n], `monomials` of the centres in units of the scaling.
    """

    patches: PatchLevel
    numbers: npt.NDArray[np.int64]
    scaling: Scaling
    powers: FloatArray

    def without(self, left_out: MaskArray) -> "JointLevel":
        """The same, with some patches never seen, bool[n]."""
        return replace(self, patches=replace(self.patches, usable=self.patches.usable & ~left_out))

    def part(self, chosen: npt.NDArray[np.int64]) -> "JointLevel":
        """Some of the patches, by their indices."""
        return JointLevel(
            self.patches.part(chosen), self.numbers[chosen], self.scaling, self.powers[:, chosen]
        )


def spread_order(count: int) -> npt.NDArray[np.int64]:
    """The numbers below `count` so that each leading part is spread evenly over them all, int64[count].

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
        centres: float64[n, 2], their centres, px of the level.
        numbers: int64[n], which of the key picture's patches they are.
    """
    scaling = Scaling.of(centres)
    powers = monomials((centres - scaling.middle) / scaling.size)
    return JointLevel(prepare(patches, centres), numbers, scaling, powers)


def solved_step(
    level: JointLevel, shift: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """The step that suits shifts of the first patches best, by their inverse covariances.

    Args:
        level: the patches.
        shift: float64[2, n], px.
        information: float64[3, n], or float64[n] where it is the same in x and y.

    Returns:
        Its parameters float64[8], how it moves each of the patches float64[2, n], and the normal matrix.
    """
    count, size = shift.shape[1], level.scaling.size
    powers = level.powers[:, :count]
    if information.ndim > 1:
        weighted = (powers * information[:, np.newaxis]).reshape(18, count)
        normal, wanted = _NORMAL_OF_THREE @ (weighted @ powers.T).ravel(), _WANTED_OF_THREE
    else:
        weighted = powers * information
        normal, wanted = _NORMAL_OF_ONE @ (weighted @ powers.T).ravel(), _WANTED_OF_ONE
    normal = normal.reshape(8, 8)
    sides = wanted @ (weighted @ shift.T).reshape(-1, 1)
    solved, found = cv2.solve(normal, sides / size, flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return None
    parameters = np.asarray(found[:, 0], dtype=np.float64)
    return parameters, (_MOVES @ (parameters * size)).reshape(2, 6) @ powers, normal


def step_matrix(scaling: Scaling, parameters: FloatArray) -> FloatArray:
    """The homography near the identity of some parameters, in px."""
    step = IDENTITY.copy()
    step.ravel()[:8] += parameters
    return scaling.forth @ step @ scaling.back
