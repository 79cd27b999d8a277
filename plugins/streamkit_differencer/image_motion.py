"""Alignment of an image to the patches of another one, from which the camera's motion is measured.

One motion is fitted to all patches together: edges count as well as corners, and a patch that shows something
else, such as a vehicle, loses its weight.

Source: Baker and Matthews, "Lucas-Kanade 20 Years On: A Unifying Framework", IJCV 2004, the inverse
compositional algorithm with weights; the residual is that of the normalised patches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.homography import corners, project
from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage
from streamkit_differencer.sampling import downsampled

PointArray = NDArray[np.float32]

# Patches of an image, and the least gradient in the middle of one, grey levels per px.
MAX_PATCHES = 300
PATCH_PX = 9
MIN_GRADIENT = 4.0
# A patch is explained where the image correlates with it; one that correlates less than the second number has
# no weight in the fit.
MIN_CORRELATION, OUTLIER_CORRELATION = 0.9, 0.3
# Weight of an image in the trust in a patch.
TRUST_RATE = 0.1
# Cells of a 4 by 4 grid that explained patches must lie in: a single moving object is no camera motion.
SPREAD_CELLS = 6
# Levels of a pyramid, each of half the size; images are not made smaller than this.
MAX_LEVELS, MIN_LEVEL_PX = 3, 36
# The fit ends when a step moves no corner by more, px.
MIN_STEP_PX = 0.02
# Weight of the previous step in the normal equations, per patch: none drifts along an edge without end.
DAMPING = 1e-3
# Columns of the parameters of a homography that a similarity combines: turn, scale, shift along x and y.
SIMILARITY = np.array(
    [[0, -1, 0, 1, 0, 0, 0, 0], [1, 0, 0, 0, 1, 0, 0, 0], [0, 0, 1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1, 0, 0]],
    np.float64,
).T
TURN_AND_SHIFT = SIMILARITY[:, [0, 2, 3]]
HOMOGRAPHY = np.eye(8)


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Patches of an image around its strongest gradients, one in each cell of a grid.

    Attributes:
        points: float32[n, PATCH_PX**2, 2], their pixels.
        texture: float32[n, PATCH_PX**2], each with mean 0 and sum of squares 1.
        cells: int64[n], the cell of a 4 by 4 grid that each lies in.
        grid: float64[3, 3], pixels to coordinates between about -1 and 1, in which parameters are measured.
        slopes: float32[n, PATCH_PX**2, 8], derivatives of the texture by the parameters of a homography.
        normals: float32[n, 8, 8], of each patch: the products of its slopes.
        trust: float32[n], 0 to 1: how well each patch was found in images, a running mean, updated in place.
    """

    points: PointArray
    texture: FloatImage
    cells: NDArray[np.int64]
    grid: FloatArray
    slopes: NDArray[np.float32]
    normals: NDArray[np.float32]
    trust: NDArray[np.float32]

    @classmethod
    def of(cls, image: ByteImage) -> Patches:
        """The patches of a smoothed image, uint8[h, w]."""
        across, down = (cv2.Sobel(image, cv2.CV_32F, x, 1 - x, scale=0.125) for x in (1, 0))
        points = _points(np.hypot(across, down))
        height, width = image.shape
        half = 0.5 * math.hypot(width, height)
        grid = np.array(
            [[1 / half, 0, -0.5 * width / half], [0, 1 / half, -0.5 * height / half], [0, 0, 1.0]]
        )
        middle = points[:, PATCH_PX**2 // 2] if len(points) else np.zeros((0, 2))
        cells = np.floor(middle * 4 / (width, height)).astype(np.int64) @ np.array([1, 4])
        columns, rows = (points[..., axis].astype(np.intp) for axis in (0, 1))
        values, gradient_x, gradient_y = (
            np.asarray(plane[rows, columns], np.float32) for plane in (image, half * across, half * down)
        )
        texture, norms = _normalised(values)
        slopes = _slopes(points, grid, gradient_x, gradient_y) / norms[..., None]
        # Normalised patches have neither offset nor gain.
        slopes -= slopes.mean(axis=1, keepdims=True)
        slopes -= texture[..., None] * (texture[..., None] * slopes).sum(axis=1, keepdims=True)
        normals = np.matmul(slopes.swapaxes(1, 2), slopes)
        return cls(points, texture, cells, grid, slopes, normals, np.ones(len(points), np.float32))

    def __len__(self) -> int:
        return len(self.points)

    def explained(self, image: ByteImage, to_image: FloatArray) -> tuple[float, float]:
        """Share of the patches that an image repeats, and the sum of all weights.

        The share is 0 if those patches lie in a small part of the image. `to_image` maps the patches' pixels
        to those of the image.
        """
        likeness = (self._sampled(image, to_image) * self.texture).sum(axis=1)
        is_like = likeness > MIN_CORRELATION
        is_spread = len(np.unique(self.cells[is_like])) >= SPREAD_CELLS
        share = float(self.trust[is_like].sum() / max(self.trust.sum(), 1.0)) if is_spread else 0.0
        return share, float(_weights(likeness) @ self.trust)

    def learn(self, image: ByteImage, to_image: FloatArray) -> None:
        """Lowers the trust in patches that an image does not repeat, such as those of water and vehicles."""
        weights = _weights((self._sampled(image, to_image) * self.texture).sum(axis=1))
        self.trust[:] += TRUST_RATE * (weights - self.trust)

    def aligned(self, image: ByteImage, to_image: FloatArray, basis: FloatArray, steps: int) -> FloatArray:
        """The motion near another one that explains the patches best, float64[3, 3].

        Args:
            image: uint8[h, w], smoothed.
            to_image: float64[3, 3], where to begin: the patches' pixels to those of the image.
            basis: `TURN_AND_SHIFT`, `SIMILARITY` or `HOMOGRAPHY`, the parameters to fit.
            steps: largest number of iterations.
        """
        for _ in range(steps):
            found = self._sampled(image, to_image)
            weights = _weights((found * self.texture).sum(axis=1)) * self.trust
            normal = basis.T @ np.tensordot(weights, self.normals, axes=1).astype(np.float64) @ basis
            residual = (found - self.texture) * weights[:, None]
            target = basis.T @ (residual.ravel() @ self.slopes.reshape(-1, 8)).astype(np.float64)
            normal += DAMPING * np.trace(normal) * np.eye(len(normal)) / len(normal)
            if not np.trace(normal) > 0.0:
                break
            step = np.append(basis @ np.linalg.solve(normal, target), 0.0).reshape(3, 3) + np.eye(3)
            moved = np.linalg.inv(self.grid) @ np.linalg.inv(step) @ self.grid
            to_image = to_image @ moved
            to_image = to_image / to_image[2, 2]
            if np.abs(step - np.eye(3)).max() / self.grid[0, 0] < MIN_STEP_PX:
                break
        return to_image

    def _sampled(self, image: ByteImage, to_image: FloatArray) -> FloatImage:
        """The image in the patches, normalised, float32[n, PATCH_PX**2]."""
        if not len(self):
            return self.texture
        across, down = cv2.split(cv2.perspectiveTransform(self.points, to_image))
        return _normalised(np.asarray(cv2.remap(image, across, down, cv2.INTER_LINEAR), np.float32))[0]


def _points(gradient: FloatImage) -> PointArray:
    """Pixels around the strongest gradient in each cell of a grid, float32[n, PATCH_PX**2, 2]."""
    # Patches do not leave the image.
    border = PATCH_PX // 2
    inner = gradient[border:-border, border:-border] if min(gradient.shape) > PATCH_PX else gradient[:0, :0]
    size = max(PATCH_PX, round(math.sqrt(gradient.size / MAX_PATCHES)))
    rows, columns = (length // size for length in inner.shape)
    grid = inner[: rows * size, : columns * size].reshape(rows, size, columns, size)
    cells = grid.swapaxes(1, 2).reshape(rows * columns, size * size)
    number = np.flatnonzero(cells.max(axis=1, initial=0.0) > MIN_GRADIENT)
    best = cells[number].argmax(axis=1) if len(number) else number
    x, y = number % max(columns, 1) * size + best % size, number // max(columns, 1) * size + best // size
    steps = np.arange(PATCH_PX)
    around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
    return (np.column_stack([x, y])[:, None] + around).astype(np.float32)


def _slopes(
    points: PointArray, grid: FloatArray, across: FloatImage, down: FloatImage
) -> NDArray[np.float32]:
    """Derivatives of pixels, with gradients in the grid's units, by the parameters of a homography."""
    x, y = (points[..., axis] * np.float32(grid[axis, axis]) + np.float32(grid[axis, 2]) for axis in (0, 1))
    along = across * x + down * y
    parts = across * x, across * y, across, down * x, down * y, down, -along * x, -along * y
    return np.ascontiguousarray(np.stack(parts, axis=-1), np.float32)


def _weights(correlations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Weight of each patch in the fit, 0 to 1."""
    excess = np.maximum(correlations - OUTLIER_CORRELATION, 0.0) / (1.0 - OUTLIER_CORRELATION)
    return np.asarray(np.square(excess), np.float32)


def _normalised(values: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Patches with mean 0 and sum of squares 1, float32[n, pixels], and what they were divided by."""
    values = values - values.mean(axis=1, keepdims=True)
    norms = np.maximum(np.linalg.norm(values, axis=1, keepdims=True), PATCH_PX)
    return cast("FloatImage", values / norms), norms


def pyramid(image: ByteImage) -> list[ByteImage]:
    """A smoothed image in several sizes, the full one first, each half as wide as the one before."""
    levels = [cast("ByteImage", cv2.GaussianBlur(image, (5, 5), 1.0))]
    while len(levels) < MAX_LEVELS and min(levels[-1].shape) >= 2 * MIN_LEVEL_PX:
        levels.append(downsampled(levels[-1], 2))
    return levels


def corner_distance(first: FloatArray, second: FloatArray, shape: tuple[int, ...]) -> float:
    """Largest distance, along an axis, of an image corner under two homographies, px."""
    outline = corners((shape[0], shape[1]))
    return float(np.abs(project(first, outline) - project(second, outline)).max())
