"""Learns a feature space: from labelled windows in one batch, or from a stream in bounded batches."""

from collections.abc import Sequence

import numpy as np

from streamkit_wavelet_eigen.blocks import cut_blocks
from streamkit_wavelet_eigen.eigenspace import (
    FloatArray,
    learn_eigenspace,
    learn_fisher_axes,
    update_eigenspace,
)
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, flat_windows, validated_patches
from streamkit_wavelet_eigen.gallery import check_gallery_size
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.virtual_views import prepared_views, view_count
from streamkit_wavelet_eigen.wavelet import FloatBatch

# The fewest windows that differ, so the fewest that give an eigenvector.
FIRST_BATCH = 2
# Eigenvectors kept beyond those asked for. What an update truncates is lost for later ones: without the
# extra eigenvectors the leading directions of 200 windows end up to 7 degrees from those of a single batch.
EXTRA_COMPONENTS = 8


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
    coordinates = space.embed_prepared(prepared, np.zeros(len(prepared), bool)).astype(np.float64)
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


class SpaceLearner:
    """Learns a space from a stream of prepared windows.

    The first windows are learnt as soon as two are there, so that a stream has features from its start;
    later ones every `batch` windows. A call makes at most one update and at most `batch` windows are pending.

    Args:
        recipe: how to make the space; without a Fisher step.
        batch: windows per update, at least 2.
        forgetting: weight of the past at each update, 0 < forgetting <= 1.
        start: initial space, or None.
    """

    def __init__(
        self, recipe: Recipe, *, batch: int, forgetting: float, start: WaveletEigenSpace | None = None
    ) -> None:
        self.space = start
        self._untruncated = start.spaces if start else ()
        self._components = min(recipe.components + EXTRA_COMPONENTS, recipe.block_values)
        self._recipe = recipe
        self._batch = batch
        self._forgetting = forgetting
        self._pending: list[FloatBatch] = []

    def add(self, prepared: FloatBatch, at_most: int | None = None) -> WaveletEigenSpace | None:
        """Adds windows float32[n, h, w] and returns the newest space, None before the first.

        Windows beyond `at_most` and beyond the batch are left out evenly, so that a crowded frame neither
        delays the stream nor counts for more than one batch.
        """
        for limit in (at_most or self._batch, self._batch - len(self._pending)):
            if len(prepared) > limit:
                prepared = prepared[np.linspace(0, len(prepared) - 1, limit).round().astype(int)]
        self._pending.extend(window.copy() for window in prepared)
        if len(self._pending) >= (FIRST_BATCH if self.space is None else self._batch):
            self._update(np.stack(self._pending))
            self._pending.clear()
        return self.space

    def _update(self, prepared: FloatBatch) -> None:
        recipe, before = self._recipe, self.space
        batches = vectors_by_space(prepared, recipe)
        if before is None:
            self._untruncated = tuple(learn_eigenspace(vectors, self._components) for vectors in batches)
        else:
            self._untruncated = tuple(
                update_eigenspace(space, vectors, self._components, self._forgetting)
                for space, vectors in zip(self._untruncated, batches, strict=True)
            )
        spaces = tuple(space.truncated(recipe.components, recipe.energy) for space in self._untruncated)
        self.space = WaveletEigenSpace(spaces, recipe, before.version + 1 if before else 1)
