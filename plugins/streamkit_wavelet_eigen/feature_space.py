"""An immutable feature space that embeds windows."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product
from streamkit_wavelet_eigen.blocks import cut_blocks, join_blocks
from streamkit_wavelet_eigen.eigenspace import Eigenspace, FloatArray
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Recipe
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
        return self.embed_prepared(prepare(patches, self.recipe.preprocessing), flat_windows(patches))

    def embed_prepared(self, prepared: FloatBatch, flat: NDArray[np.bool_]) -> FloatBatch:
        """Vectors float32[n, length] of prepared windows; zeros where `flat`, bool[n], is set."""
        return self.project(prepared, flat).vectors

    def project(self, prepared: FloatBatch, flat: NDArray[np.bool_]) -> Projection:
        """Vectors of prepared windows with their residuals; vectors are zeros where `flat` is set.

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
    result: NDArray[np.bool_] = patches.std(axis=(1, 2)) < FLAT_DEVIATION
    return result
