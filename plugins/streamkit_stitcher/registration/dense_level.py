"""A keyframe at one size, prepared for dense alignment, and its comparison with a frame, block by block."""

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    corners,
    inverse,
    normalised,
    translation,
)
from streamkit_stitcher.registration.block_sums import BLOCK, SingleArray, compare_blocks
from streamkit_stitcher.registration.correlation import texture_shift
from streamkit_stitcher.registration.gauss_newton import slopes, step_matrix, step_parameters, worst_deviation
from streamkit_stitcher.registration.patches import halved

_LEVELS: Final = 3
_MIN_SIDE: Final = 60
_NEIGHBOURHOOD: Final = 4.0
_SMOOTHING: Final = 0.8
# Grey levels below which contrast is taken for noise.
_NOISE: Final = 4.0
_WEAK_POWER: Final = 0.05
# Difference of a block, as a part of both powers, at which it has a quarter of its weight, and at which it
# counts as a quarter of agreement; 1 is unrelated.
_UNLIKE: Final = 0.15
_RELATED: Final = 0.3
_MIN_VARIANCE: Final = 0.005
_ITERATIONS: Final = 6
_SETTLED: Final = 0.03
# Differences are alike over parts of the frame, as shadows and edges are: it counts as so many measurements.
_INDEPENDENT: Final = 250.0
# Parts of the frame in x and in y whose agreement is compared.
_PARTS: Final = 6
# The parameters of a step here, shift x, y, scale, rotation, two of shear, two of perspective, by those of
# `gauss_newton`; and their deviations.
_BASIS: Final[FloatArray] = np.zeros((8, 8))
_BASIS[[0, 1, 2, 3, 4, 5, 6, 7], [2, 5, 0, 3, 0, 1, 6, 7]] = 1
_BASIS[[2, 3, 4, 5], [4, 1, 4, 3]] = 1, -1, -1, 1
_FROM_BASIS: Final[FloatArray] = np.asarray(np.linalg.inv(_BASIS.T), np.float64)
STEP_RATIOS: Final[FloatArray] = np.array([1.0, 1.0, 0.3, 0.3, 0.1, 0.1, 0.07, 0.07])


def texture(grey: GreyArray) -> SingleArray:
    """Contrast relative to its neighbourhood, float32[h, w]: faint texture counts as much as strong edges."""
    image = grey.astype(np.float32)
    detail = image - cv2.GaussianBlur(image, (0, 0), _NEIGHBOURHOOD)
    power = cv2.GaussianBlur(detail * detail, (0, 0), _NEIGHBOURHOOD)
    return np.asarray(cv2.GaussianBlur(detail / np.sqrt(power + _NOISE**2), (0, 0), _SMOOTHING), np.float32)


def textures_of(grey: GreyArray) -> tuple[SingleArray, ...]:
    """The `texture` of the image and of its halvings, coarsest first."""
    return tuple(texture(image) for image in levels_of(grey))


def levels_of(grey: GreyArray) -> tuple[GreyArray, ...]:
    """The image and at most two halvings, coarsest first."""
    images = [grey]
    while len(images) < _LEVELS and min(images[-1].shape) >= 2 * _MIN_SIDE:
        images.append(halved(images[-1]))
    return tuple(images[::-1])


class DenseLevel:
    """A keyframe at one size, prepared for dense alignment.

    Args:
        grey: uint8[h, w].
    """

    def __init__(self, grey: GreyArray) -> None:
        height, width = self.shape = (int(grey.shape[0]), int(grey.shape[1]))
        self._blocks = max(1, height // BLOCK), max(1, width // BLOCK)
        self._texture = texture(grey)
        self._across, self._down = (
            np.asarray(cv2.Scharr(self._texture, cv2.CV_32F, *order, scale=1 / 32), np.float32)
            for order in ((1, 0), (0, 1))
        )
        across, down = self._across, self._down
        self._structure = np.stack(
            [self._mean(across * across), self._mean(across * down), self._mean(down * down)]
        )
        self._power = self._mean(self._texture * self._texture)
        self._scaling = np.array([(width - 1) / 2, (height - 1) / 2, max(height, width) / 2])
        rows, columns = np.mgrid[0 : self._blocks[0], 0 : self._blocks[1]] * BLOCK + (BLOCK - 1) / 2
        self.centres = np.stack([columns.ravel(), rows.ravel()], axis=1)
        self._slopes = _BASIS @ slopes(self.centres, self._scaling)
        self._corner_slopes = _BASIS @ slopes(corners(self.shape), self._scaling)
        (x, y), (xx, xy, yy) = self._slopes, self._structure
        self._steepest = xx * x + xy * y, xy * x + yy * y

    def corner_std(self, covariance: FloatArray) -> float:
        """Standard deviation at the worst corner, px, of a step's covariance, float64[8, 8]."""
        return worst_deviation(_BASIS.T @ covariance @ _BASIS, self._scaling, corners(self.shape))

    def _mean(self, values: Any) -> FloatArray:
        """The mean of each block, float64[n]."""
        rows, columns = self._blocks
        part = values[: rows * BLOCK, : columns * BLOCK]
        means = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(means, np.float64).ravel()

    def compare(self, image: SingleArray, motion: FloatArray) -> "BlockComparison":
        """Compares the keyframe with a texture of the same size under a motion, keyframe to frame."""
        size = self.shape[1], self.shape[0]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        # Beyond the frame is NaN, and so is the mean of every block that reaches there.
        moved = np.asarray(
            cv2.warpPerspective(image, motion, size, flags=flags, borderValue=float("nan")), np.float32
        )
        means = compare_blocks(moved, self._texture, self._across, self._down).reshape(4, -1)
        visible = np.isfinite(means[0])
        squares, own_power, *sides = np.where(visible, means, 0.0).astype(np.float64)
        power = self._power + own_power + _WEAK_POWER
        weights, alike = (visible / (1 + (squares / (u * power)) ** 2) ** 2 for u in (_UNLIKE, _RELATED))
        contrast = self._structure[0] + self._structure[2]
        seen = float((visible * contrast).sum())
        agreement = float((alike * contrast).sum()) / seen if seen > 0 else 0.0
        return BlockComparison(weights, alike, squares, np.stack(sides), visible, agreement)

    def shift_to(self, image: SingleArray) -> FloatArray:
        """The shift to a texture of the same size at which their overlap correlates best, float64[3, 3]."""
        x, y, _ = texture_shift(self._texture.astype(np.float64), image.astype(np.float64))
        return translation(np.array([-x, -y]))

    def evidence(self, one: "BlockComparison", other: "BlockComparison") -> float:
        """By how much one comparison agrees more than another, in deviations of the parts of the frame.

        Source: Vuong, Likelihood ratio tests for model selection, Econometrica 1989.
        """
        contrast = (self._structure[0] + self._structure[2]) * (one.visible & other.visible)
        gains = (contrast * (one.alike - other.alike)).reshape(self._blocks)
        parts = cv2.resize(gains, (_PARTS, _PARTS), interpolation=cv2.INTER_AREA)
        return float(parts.sum() / max(1e-9, float(np.linalg.norm(parts))))

    def neighbours(self, distance: float) -> list[FloatArray]:
        """Steps by `distance` px at the worst corner, float64[3, 3]: shifts, scale and turn, either way."""
        x, y = self._corner_slopes
        lengths = distance / np.hypot(x, y).max(axis=1)
        return [
            self.matrix_of(way * lengths[number] * np.eye(8)[number])
            for number in range(4)
            for way in (1, -1)
        ]

    def refine(
        self,
        image: SingleArray,
        motion: FloatArray,
        prediction: FloatArray,
        covariance: FloatArray,
    ) -> tuple[FloatArray, FloatArray, "BlockComparison"]:
        """The likeliest motion near a prediction, its covariance, and the comparison there.

        Args:
            image: texture of the frame.
            motion: to begin with, keyframe to frame.
            prediction: keyframe to frame.
            covariance: float64[8, 8], of the step from the prediction, px.
        """
        information = np.linalg.inv(covariance)
        x, y = self._slopes
        predicted = inverse(prediction)
        compared = self.compare(image, motion)
        for _ in range(_ITERATIONS):
            weights = compared.weights
            normal = (self._steepest[0] * weights) @ x.T + (self._steepest[1] * weights) @ y.T
            sides = (x * weights) @ compared.sides[0] + (y * weights) @ compared.sides[1]
            scale = _INDEPENDENT / (len(self.centres) * compared.variance)
            whole = scale * normal + information
            away = self.step_of(predicted @ motion)
            step = np.linalg.solve(whole, -scale * sides - information @ away)
            motion = normalised(motion @ self.matrix_of(step))
            compared = self.compare(image, motion)
            if float(np.abs(step).max()) < _SETTLED:
                break
        return motion, np.linalg.inv(whole), compared

    def matrix_of(self, step: FloatArray) -> FloatArray:
        """The homography of a step, float64[3, 3], from its parameters, float64[8], px."""
        return step_matrix(_BASIS.T @ step, self._scaling)

    def step_of(self, matrix: FloatArray) -> FloatArray:
        """The parameters of a step, float64[8], px, from its homography."""
        return np.asarray(_FROM_BASIS @ step_parameters(matrix, self._scaling), np.float64)

    def similarity_of(self, motion: FloatArray) -> FloatArray:
        """A motion without its shear and perspective, float64[3, 3]."""
        step = self.step_of(motion)
        step[4:] = 0
        return self.matrix_of(step)


@dataclass(frozen=True, eq=False)
class BlockComparison:
    """A keyframe compared with a frame, block by block.

    Attributes:
        weights: float64[n], 0 for blocks that differ to 1 for equal ones.
        alike: float64[n], the same, for larger differences.
        squares: float64[n], mean squared difference of the textures.
        sides: float64[2, n], mean product of the difference with the gradient, in x and y.
        visible: bool[n], blocks inside the frame.
        agreement: share of the contrast in view that agrees, 0 to 1.
    """

    weights: FloatArray
    alike: FloatArray
    squares: FloatArray
    sides: FloatArray
    visible: npt.NDArray[np.bool_]
    agreement: float

    @property
    def variance(self) -> float:
        """Mean squared difference of the blocks that agree."""
        counted = self.weights**2
        total = float(counted.sum())
        return max(_MIN_VARIANCE, float((counted * self.squares).sum()) / total if total > 0 else 0.0)
