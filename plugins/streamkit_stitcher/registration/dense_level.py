"""A keyframe at one size, prepared for dense alignment, and its comparison with a frame, block by block."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

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
from streamkit_stitcher.registration.block_sums import BLOCK, PIXELS, SingleArray, compare_blocks
from streamkit_stitcher.registration.correlation import ShiftSearch
from streamkit_stitcher.registration.gauss_newton import slopes, step_matrix, step_parameters, worst_deviation
from streamkit_stitcher.registration.patches import halved

_LEVELS: Final = 3
_MIN_SIDE: Final = 60
_NEIGHBOURHOOD: Final = 4.0
_SMOOTHING: Final = 0.8
# Grey levels below which contrast is taken for noise.
_NOISE: Final = 4.0
_MIN_VARIANCE: Final = 0.005
_ITERATIONS: Final = 6
_SETTLED: Final = 0.03
# Differences are alike over parts of the frame, as shadows and edges are: it counts as so many measurements.
_INDEPENDENT: Final = 250.0
# Parts of the frame in x and in y whose agreement is compared.
_PARTS: Final = 6
# Blocks of a level that are compared at most. Those of most contrast among neighbours tell as much as all:
# where movers hide all but a seventh of a scene, 1800 of 3600 are off by as much, 900 by twice as much.
_MOST_BLOCKS: Final = 2000
BlockNumbers = npt.NDArray[np.int64]
# The parameters of a step here, shift x, y, scale, rotation, two of shear, two of perspective, by those of
# `gauss_newton`; and their deviations.
_BASIS: Final[FloatArray] = np.zeros((8, 8))
_BASIS[[0, 1, 2, 3, 4, 5, 6, 7], [2, 5, 0, 3, 0, 1, 6, 7]] = 1
_BASIS[[2, 3, 4, 5], [4, 1, 4, 3]] = 1, -1, -1, 1
_FROM_BASIS: Final[FloatArray] = np.asarray(np.linalg.inv(_BASIS.T), np.float64)
STEP_RATIOS: Final[FloatArray] = np.array([1.0, 1.0, 0.3, 0.3, 0.1, 0.1, 0.07, 0.07])


def texture(grey: GreyArray) -> SingleArray:
    """Contrast relative to its neighbourhood, float32[h, w]: faint texture counts as much as strong edges."""
    # In place: new images of this size would take more time than what is computed in them.
    detail = grey.astype(np.float32)
    np.subtract(detail, _neighbourhood(detail), out=detail)
    power = _neighbourhood(detail * detail)
    np.sqrt(np.add(power, _NOISE**2, out=power), out=power)
    np.divide(detail, power, out=detail)
    return np.asarray(cv2.GaussianBlur(detail, (0, 0), _SMOOTHING, dst=power), np.float32)


def _neighbourhood(image: SingleArray) -> SingleArray:
    """The weighted mean around each pixel, blurred at half size, in a quarter of the time."""
    height, width = image.shape
    half = cv2.resize(image, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    cv2.GaussianBlur(half, (0, 0), _NEIGHBOURHOOD / 2, dst=half)
    return np.asarray(cv2.resize(half, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def textures_of(grey: GreyArray) -> tuple[SingleArray, ...]:
    """The `texture` of the image and of its halvings, coarsest first."""
    return tuple(texture(image) for image in levels_of(grey))


def levels_of(grey: GreyArray) -> tuple[GreyArray, ...]:
    """The image and at most two halvings, coarsest first."""
    images = [grey]
    while len(images) < _LEVELS and min(images[-1].shape) >= 2 * _MIN_SIDE:
        images.append(halved(images[-1]))
    return tuple(images[::-1])


def _grid(image: SingleArray) -> SingleArray:
    """The whole blocks of an image, float32[rows, 8, columns, 8]; a remainder is left out."""
    rows, columns = image.shape[0] // BLOCK, image.shape[1] // BLOCK
    return image[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)


def _cut(image: SingleArray, rows: BlockNumbers, columns: BlockNumbers) -> SingleArray:
    """The `PIXELS` of some blocks of an image, float32[n, 32]."""
    return np.ascontiguousarray(_grid(image)[rows, :, columns].reshape(-1, BLOCK * BLOCK)[:, PIXELS])


def _shares(count: int) -> FloatArray:
    """Of `count` cells side by side, what each part of the frame covers, float64[parts, count]."""
    bounds, cells = np.arange(_PARTS + 1)[:, np.newaxis] * count / _PARTS, np.arange(count)
    covered = np.clip(bounds - cells, 0.0, 1.0)
    return np.asarray(covered[1:] - covered[:-1])


def chosen_blocks(contrast: FloatArray) -> tuple[BlockNumbers, BlockNumbers]:
    """Rows and columns of the blocks that are compared: of each group of neighbours that of most contrast.

    Args:
        contrast: float[rows, columns], of the blocks.
    """
    rows, columns = contrast.shape
    high = wide = 1
    while rows * columns > _MOST_BLOCKS * high * wide:
        high, wide = (high + 1, wide) if high < wide else (high, wide + 1)
    row, column = np.indices(contrast.shape)
    groups = (row // high * columns + column // wide).ravel()
    order = np.lexsort((contrast.ravel(), groups))
    chosen = np.sort(order[np.diff(groups[order], append=-1) != 0])
    return row.ravel()[chosen], column.ravel()[chosen]


class DenseLevel:
    """A keyframe at one size, prepared for dense alignment.

    Args:
        grey: uint8[h, w].
    """

    def __init__(self, grey: GreyArray) -> None:
        height, width = self.shape = (int(grey.shape[0]), int(grey.shape[1]))
        self._texture = texture(grey)
        across, down = (
            np.asarray(cv2.Scharr(self._texture, cv2.CV_32F, *order, scale=1 / 32), np.float32)
            for order in ((1, 0), (0, 1))
        )
        contrast = _grid(across**2 + down**2).mean(axis=(1, 3))
        chosen = chosen_blocks(contrast)
        images = self._texture, across, down
        self._own, self._across, self._down = (_cut(image, *chosen) for image in images)
        means = [self._across**2, self._across * self._down, self._down**2, self._own**2]
        *structure, self._power = np.array([part.mean(axis=1) for part in means], np.float64)
        self._structure = np.array(structure)
        self._contrast = self._structure[0] + self._structure[2]
        self._scaling = np.array([(width - 1) / 2, (height - 1) / 2, max(height, width) / 2])
        self._origins = np.stack(chosen[::-1], axis=1) * float(BLOCK)
        down_parts, across_parts = (
            _shares(count)[:, cells] for count, cells in zip(contrast.shape, chosen, strict=True)
        )
        self._parts = (down_parts[:, np.newaxis] * across_parts).reshape(_PARTS**2, len(self._own))
        self.centres = self._origins + (BLOCK - 1) / 2
        self._slopes = _BASIS @ slopes(self.centres, self._scaling)
        self._corner_slopes = _BASIS @ slopes(corners(self.shape), self._scaling)
        (x, y), (xx, xy, yy) = self._slopes, self._structure
        self._steepest = xx * x + xy * y, xy * x + yy * y

    def corner_std(self, covariance: FloatArray) -> float:
        """Standard deviation at the worst corner, px, of a step's covariance, float64[8, 8]."""
        return worst_deviation(_BASIS.T @ covariance @ _BASIS, self._scaling, corners(self.shape))

    def compare(self, image: SingleArray, motion: FloatArray) -> "BlockComparison":
        """Compares the keyframe with a texture of the same size under a motion, keyframe to frame."""
        visible, weights, alike, squares, *sides = compare_blocks(
            image, motion, self._origins, self._own, self._across, self._down, self._power
        )
        seen = float(visible @ self._contrast)
        agreement = float(alike @ self._contrast) / seen if seen > 0 else 0.0
        return BlockComparison(weights, alike, squares, (sides[0], sides[1]), visible > 0, agreement)

    @cached_property
    def _search(self) -> ShiftSearch:
        return ShiftSearch(self._texture)

    def shift_to(self, image: SingleArray) -> FloatArray:
        """The shift to a texture of the same size at which their overlap correlates best, float64[3, 3]."""
        x, y, _ = self._search.shift_from(image)
        return translation(np.array([-x, -y]))

    def evidence(self, one: "BlockComparison", other: "BlockComparison") -> float:
        """By how much one comparison agrees more than another, in deviations of the parts of the frame.

        Source: Vuong, Likelihood ratio tests for model selection, Econometrica 1989.
        """
        gains = self._contrast * (one.visible & other.visible) * (one.alike - other.alike)
        parts = self._parts @ gains
        return float(parts.sum() / max(1e-9, float(np.linalg.norm(parts))))

    def neighbours(self, distance: float) -> list[FloatArray]:
        """Steps by `distance` px at the worst corner, float64[3, 3]: shifts, scale and turn, either way."""
        return self._steps_along(np.eye(8)[:4], distance)

    def least_certain(self, covariance: FloatArray, distance: float) -> list[FloatArray]:
        """Steps by `distance` px at the worst corner where a motion is least certain, either way.

        Args:
            covariance: float64[8, 8], of the motion's parameters.
            distance: px.
        """
        of_corners = np.einsum("ipk,pq,jqk->kij", self._corner_slopes, covariance, self._corner_slopes)
        variances, directions = np.linalg.eigh(of_corners)
        worst = int(variances[:, 1].argmax())
        step = covariance @ (directions[worst, :, 1] @ self._corner_slopes[:, :, worst])
        return self._steps_along(step[np.newaxis], distance)

    def _steps_along(self, directions: FloatArray, distance: float) -> list[FloatArray]:
        """Steps along each of float64[n, 8], either way, by `distance` px at the corner that moves most."""
        x, y = self._corner_slopes
        lengths = distance / np.hypot(directions @ x, directions @ y).max(axis=1)
        steps = lengths[:, np.newaxis] * directions
        return [self.matrix_of(way * step) for step in steps for way in (1, -1)]

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
            scale = _INDEPENDENT / (max(1, len(self.centres)) * compared.variance)
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
        sides: float64[n] each, mean product of the difference with the gradient, in x and in y.
        visible: bool[n], blocks inside the frame.
        agreement: share of the contrast in view that agrees, 0 to 1.
    """

    weights: FloatArray
    alike: FloatArray
    squares: FloatArray
    sides: tuple[FloatArray, FloatArray]
    visible: npt.NDArray[np.bool_]
    agreement: float

    @property
    def variance(self) -> float:
        """Mean squared difference of the blocks that agree."""
        counted = self.weights**2
        total = float(counted.sum())
        return max(_MIN_VARIANCE, float((counted * self.squares).sum()) / total if total > 0 else 0.0)
