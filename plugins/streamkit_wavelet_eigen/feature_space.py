"""A feature space that embeds windows, and how it is learnt from windows in one batch."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product
from streamkit_wavelet_eigen.eigenspace import Eigenspace, FloatArray, learn_eigenspace, learn_fisher_axes
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.virtual_views import check_gallery_size, prepared_views, view_count
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Standard deviation in grey levels; a window below it shows noise, not a target.
FLAT_DEVIATION = 4.0


@dataclass(frozen=True, eq=False)
class Projection:
    """Prepared windows projected into a space.

    Attributes:
        vectors: float32[n, length], the feature vectors; zeros for flat windows.
        errors: float32[n], root mean square reconstruction error, grey levels.
        energy: float32[n], share of the window's difference from the mean in the eigenvectors, 0 to 1.
    """

    vectors: FloatBatch
    errors: FloatBatch
    energy: FloatBatch


@dataclass(frozen=True, eq=False)
class WaveletEigenSpace:
    """Embeds windows: prepares them, cuts them into blocks and projects the blocks.

    Vectors of different versions are coordinates on different axes: compare vectors of one version only.

    Attributes:
        spaces: one eigenspace for whole windows or for all blocks, or one for each block, row by row.
        recipe: how windows are prepared and cut.
        version: increases by one with each update.
        fisher_axes: float64[blocks * components, f] of the Fisher step, or None without one.
    """

    spaces: tuple[Eigenspace, ...]
    recipe: Recipe
    version: int
    fisher_axes: FloatArray | None = None

    @property
    def patch_size(self) -> tuple[int, int]:
        """(height, width) of the windows that `embed` takes, px."""
        return self.recipe.patch_size

    @property
    def rank(self) -> int:
        """Largest number of eigenvectors of an eigenspace."""
        return max(space.rank for space in self.spaces)

    @property
    def length(self) -> int:
        """Number of values in a feature vector."""
        if self.fisher_axes is not None:
            return int(self.fisher_axes.shape[1])
        return self.recipe.blocks**2 * self.recipe.components

    def embed(self, patches: FloatBatch) -> FloatBatch:
        """Feature vectors of windows.

        Args:
            patches: float32[n, h, w] in grey levels 0..255, (h, w) being `patch_size`.

        Returns:
            float32[n, length]; a flat window (deviation below 4 grey levels) has a row of zeros.

        Raises:
            ValueError: windows have another size, or one has NaN or infinity.
        """
        patches = validated_patches(patches, self.patch_size)
        return self.project(prepare(patches, self.recipe.preprocessing), flat_windows(patches)).vectors

    def project(self, prepared: FloatBatch, flat: NDArray[np.bool_]) -> Projection:
        """Vectors of prepared windows float32[n, h, w], and their residuals; zeros where `flat`, bool[n].

        A vector is the coordinates of all blocks, after the Fisher step if there is one.
        """
        basis, offsets, means = self._stacked
        blocks = cut_blocks(prepared, self.recipe.blocks)
        count, parts, values = blocks.shape
        if len(basis) == 1:
            # One product for the blocks of a shared basis.
            projected = product(blocks.reshape(count * parts, values), basis[0]) - offsets[0]
        else:
            projected = (product(blocks.swapaxes(0, 1), basis) - offsets[:, None]).swapaxes(0, 1)
        coordinates = projected.reshape(count, parts * basis.shape[2])
        axes = self.fisher_axes
        vectors = coordinates.copy() if axes is None else coordinates @ axes.astype(np.float32)
        vectors[flat] = 0.0
        centred = (blocks - means).reshape(count, parts * values)
        total = np.vecdot(centred, centred)
        kept = np.vecdot(coordinates, coordinates)
        residual = np.maximum(total - kept, 0.0) / max(parts * values, 1)
        energy = np.divide(kept, total, out=np.ones_like(total), where=total > 0)
        return Projection(vectors, np.sqrt(residual), np.clip(energy, 0.0, 1.0))

    def reconstruct(self, prepared: FloatBatch) -> FloatBatch:
        """Prepared windows float32[n, h, w] reconstructed from their coordinates, in grey levels."""
        blocks = cut_blocks(prepared, self.recipe.blocks).astype(np.float64)
        for index in range(blocks.shape[1]):
            space = self.spaces[index % len(self.spaces)]
            blocks[:, index] = space.reconstruct(space.project(blocks[:, index]))
        return join_blocks(blocks, self.recipe.prepared_size)

    @cached_property
    def _stacked(self) -> tuple[FloatBatch, FloatBatch, FloatBatch]:
        """float32[s, d, k] bases, their products with the means [s, k], and the means [s, d]."""
        spaces, values, components = len(self.spaces), self.recipe.block_values, self.recipe.components
        basis = np.zeros((spaces, values, components), np.float32)
        means = np.stack([space.mean for space in self.spaces])
        offsets = np.zeros((spaces, components), np.float32)
        for index, space in enumerate(self.spaces):
            basis[index, :, : space.rank] = space.basis.T
            offsets[index, : space.rank] = space.basis @ space.mean
        return basis, offsets, means.astype(np.float32)


def validated_patches(patches: FloatBatch, patch_size: tuple[int, int]) -> FloatBatch:
    """The windows as float32[n, h, w], clipped to 0..255.

    Raises:
        ValueError: they are not [n, h, w] of this size, or one is not finite.
    """
    patches = np.asarray(patches, dtype=np.float32)
    if patches.ndim != 3 or patches.shape[1:] != patch_size:
        height, width = patch_size
        raise ValueError(f"embed: patches must be float32[n, {height}, {width}], got shape {patches.shape}")
    finite = np.isfinite(patches).all(axis=(1, 2))
    if not finite.all():
        raise ValueError(
            f"embed: patches must be finite, patch {int(finite.argmin())} has NaN or infinity; leave it out"
        )
    return np.clip(patches, 0.0, 255.0)


def flat_windows(patches: FloatBatch) -> NDArray[np.bool_]:
    """bool[n]: windows of float32[n, h, w] without structure."""
    # With sums in float32, rounding would decide on windows at the limit.
    result: NDArray[np.bool_] = patches.astype(np.float64).std(axis=(1, 2)) < FLAT_DEVIATION
    return result


def learn_space(patches: FloatBatch, recipe: Recipe, labels: Sequence[str] = ()) -> WaveletEigenSpace:
    """Learns a space from windows in one batch.

    Args:
        patches: float32[m, h, w], grey levels 0..255; flat ones are left out.
        recipe: how to make the space.
        labels: m names; needed for a Fisher step only.

    Raises:
        ValueError: the recipe is inconsistent, all windows are flat, there are too many of them, or the
            labels do not suit a Fisher step.
    """
    recipe.check()
    patches = validated_patches(patches, recipe.patch_size)
    usable = ~flat_windows(patches)
    if not usable.any():
        raise ValueError(
            f"learning a space: at least one window must show structure, got {len(patches)} windows, "
            "all of them flat; give others"
        )
    check_gallery_size(int(usable.sum()), recipe)
    prepared = prepared_views(patches[usable], recipe.views, recipe.preprocessing)
    spaces = tuple(
        learn_eigenspace(vectors, recipe.components, recipe.energy)
        for vectors in vectors_by_space(prepared, recipe)
    )
    space = WaveletEigenSpace(spaces, recipe, 1)
    if not recipe.discriminative:
        return space
    if len(labels) != len(patches):
        raise ValueError(
            f"Fisher step: each window needs a label, got {len(patches)} windows and {len(labels)} labels"
        )
    names = [name for name, kept in zip(labels, usable, strict=True) if kept] * view_count(recipe.views)
    coordinates = space.project(prepared, np.zeros(len(prepared), bool)).vectors.astype(np.float64)
    varying = np.ptp(coordinates, axis=0) > 0
    axes = np.zeros((coordinates.shape[1], min(int(varying.sum()), len(set(names)) - 1)))
    if axes.size or len(set(names)) < 2:
        axes[varying] = learn_fisher_axes(coordinates[:, varying], names, recipe.shrinkage)
    return WaveletEigenSpace(spaces, recipe, 1, axes)


def vectors_by_space(prepared: FloatBatch, recipe: Recipe) -> list[FloatArray]:
    """Training vectors of each eigenspace, float64[m, d], from prepared windows float32[n, h, w]."""
    blocks = cut_blocks(prepared, recipe.blocks).astype(np.float64)
    if recipe.spaces == 1:
        return [blocks.reshape(-1, blocks.shape[2])]
    return [blocks[:, index] for index in range(blocks.shape[1])]


def cut_blocks(images: FloatBatch, blocks: int) -> FloatBatch:
    """Blocks float32[n, blocks * blocks, (h / blocks) * (w / blocks)] of float32[n, h, w].

    `blocks` is their number per side, a divisor of h and w.

    Source: Gottumukkal and Asari, An improved face recognition technique based on modular PCA approach, 2004.
    """
    count, height, width = images.shape
    parts = images.reshape(count, blocks, height // blocks, blocks, width // blocks)
    return parts.swapaxes(2, 3).reshape(count, blocks * blocks, height * width // (blocks * blocks))


def join_blocks(vectors: NDArray[np.floating], size: tuple[int, int]) -> FloatBatch:
    """Inverse of `cut_blocks`: float[n, blocks * blocks, d] to float32[n, h, w], `size` being (h, w)."""
    height, width = size
    count, parts = vectors.shape[:2]
    blocks = int(np.sqrt(parts))
    grid = vectors.reshape(count, blocks, blocks, height // blocks, width // blocks)
    return np.asarray(grid.swapaxes(2, 3).reshape(count, height, width), np.float32)
