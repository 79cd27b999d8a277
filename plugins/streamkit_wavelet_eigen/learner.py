"""Learns a feature space: from labelled windows in one batch, or from a stream, a bounded batch at a time."""

from collections.abc import Sequence

import numpy as np

from streamkit_wavelet_eigen.blocks import cut_blocks
from streamkit_wavelet_eigen.eigenspace import Eigenspace, FloatArray, learn_eigenspace, update_eigenspace
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, checked_patches, flat_windows
from streamkit_wavelet_eigen.fisher import learn_fisher_axes
from streamkit_wavelet_eigen.gallery import check_values
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.virtual_views import prepared_views, view_count
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Two windows are the fewest that differ, so the fewest that give an eigenvector.
FIRST_BATCH = 2
# Eigenvectors that are carried along beside those asked for: what an update cuts off is lost for later ones,
# and without them the leading directions of 200 windows end up to 7 degrees from those of one batch.
CARRIED = 8


def learn_space(patches: FloatBatch, recipe: Recipe, labels: Sequence[str] = ()) -> WaveletEigenSpace:
    """Learns a space from windows in one batch.

    Args:
        patches: float32[m, h, w], grey levels 0..255; flat ones are left out.
        recipe: what to make of them.
        labels: m names where the recipe has a Fisher step, else not needed.

    Raises:
        ValueError: the recipe does not fit together, no window has structure, there are too many for one
            batch, or the labels are not those a Fisher step needs.
    """
    recipe.check()
    patches = checked_patches(patches, recipe.patch_size)
    usable = ~flat_windows(patches)
    if not usable.any():
        raise ValueError(
            f"learning a space: at least one window must show structure, got {len(patches)} windows, "
            "all of them flat; give others"
        )
    check_values(int(usable.sum()), recipe)
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
    coordinates = space.vectors_of(prepared, np.zeros(len(prepared), bool)).astype(np.float64)
    used = np.ptp(coordinates, axis=0) > 0
    axes = np.zeros((coordinates.shape[1], min(int(used.sum()), len(set(names)) - 1)))
    if axes.size or len(set(names)) < 2:
        axes[used] = learn_fisher_axes(coordinates[:, used], names, recipe.shrinkage)
    return WaveletEigenSpace(spaces, recipe, 1, axes)


def vectors_by_space(prepared: FloatBatch, recipe: Recipe) -> list[FloatArray]:
    """The vectors that each eigenspace learns from, float64[m, d], of prepared windows float32[n, h, w]."""
    blocks = cut_blocks(prepared, recipe.blocks).astype(np.float64)
    if recipe.spaces == 1:
        return [blocks.reshape(-1, blocks.shape[2])]
    return [blocks[:, index] for index in range(blocks.shape[1])]


class SpaceLearner:
    """Collects prepared windows and makes a new snapshot of the space whenever a batch is full.

    The first space is made as soon as two windows are there, so that a stream has features from its start;
    later ones every `batch` windows. At most `batch` windows are held, and one update is made per call.

    Args:
        recipe: how the windows were prepared and what to make of them; without a Fisher step.
        batch: windows per update, at least 2.
        forgetting: weight of the past at each update, 0 < forgetting <= 1.
        start: a space to go on from, or None.
    """

    def __init__(
        self, recipe: Recipe, *, batch: int, forgetting: float, start: WaveletEigenSpace | None = None
    ) -> None:
        self.space = start
        self._wide = start.spaces if start else ()
        self._carried = min(recipe.components + CARRIED, recipe.block_values)
        self._recipe = recipe
        self._batch = batch
        self._forgetting = forgetting
        self._held: list[FloatBatch] = []

    def add(self, prepared: FloatBatch) -> WaveletEigenSpace | None:
        """Takes windows float32[n, h, w], and returns the newest space, None before the first.

        Of more windows than the batch has room for, evenly spaced ones are taken: a crowded frame neither
        delays the stream nor counts for more than a batch.
        """
        room = self._batch - len(self._held)
        if len(prepared) > room:
            prepared = prepared[np.linspace(0, len(prepared) - 1, room).round().astype(int)]
        self._held.extend(window.copy() for window in prepared)
        if len(self._held) >= (FIRST_BATCH if self.space is None else self._batch):
            self._learn(np.stack(self._held))
            self._held.clear()
        return self.space

    def _learn(self, prepared: FloatBatch) -> None:
        recipe, known = self._recipe, self.space
        sets = vectors_by_space(prepared, recipe)
        if known is None:
            self._wide = tuple(learn_eigenspace(vectors, self._carried) for vectors in sets)
        else:
            self._wide = tuple(map(self._updated, self._wide, sets))
        spaces = tuple(wide.leading(recipe.components, recipe.energy) for wide in self._wide)
        self.space = WaveletEigenSpace(spaces, recipe, known.version + 1 if known else 1)

    def _updated(self, space: Eigenspace, vectors: FloatArray) -> Eigenspace:
        return update_eigenspace(space, vectors, self._carried, self._forgetting)
