"""Appearance of the targets in a stream: learns a feature space, projects windows into it and labels them."""

from dataclasses import dataclass, field

import numpy as np

from streamkit.settings import setting
from streamkit_wavelet_eigen.eigenspace import learn_eigenspace, update_eigenspace
from streamkit_wavelet_eigen.feature_space import Projection, WaveletEigenSpace, vectors_by_space
from streamkit_wavelet_eigen.gallery import Gallery, Matches, Recogniser, prepare_gallery
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.wavelet import FloatBatch
from streamkit_wavelet_eigen.windows import Windows

# A window with more replicated border than this would teach the space streaks.
MAX_CLIPPED = 0.25
# Fewest frames that make up a batch, whatever their number of targets.
FRAMES_PER_BATCH = 4
# The fewest windows that differ, so the fewest that give an eigenvector.
FIRST_BATCH = 2
# Eigenvectors kept beyond those asked for. What an update truncates is lost for later ones: without the
# extra eigenvectors the leading directions of 200 windows end up to 7 degrees from those of a single batch.
EXTRA_COMPONENTS = 8


@dataclass(frozen=True)
class AppearanceSettings:
    """How the space is made, and how it is learnt from a stream."""

    recipe: Recipe = field(default_factory=Recipe)
    batch: int = setting(
        32, min=2, max=1024, doc="Windows per update of the space; one frame gives at most a quarter."
    )
    forgetting: float = setting(0.95, min=0.01, max=1.0, doc="Weight of the past in an update; 1 keeps all.")
    gallery_limit: int = setting(
        64, min=1, max=4096, doc="Maximum number of windows added to the gallery per label."
    )


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


class AppearanceModel:
    """The feature space, the gallery, and the recogniser that belongs to both.

    A space with a Fisher step is fixed: axes learnt from labels do not fit eigenvectors that change.

    Args:
        settings: how to learn.
        start: initial space, or None.
        gallery: labelled windows; may be empty.

    Attributes:
        space: the newest space; None before the first.

    Raises:
        ValueError: there are too many labelled windows.
    """

    def __init__(
        self, settings: AppearanceSettings, start: WaveletEigenSpace | None, gallery: Gallery
    ) -> None:
        self.settings = settings
        self._learner = SpaceLearner(
            settings.recipe, batch=settings.batch, forgetting=settings.forgetting, start=start
        )
        self._prepared_gallery = prepare_gallery(gallery, settings.recipe)
        self._recogniser: Recogniser | None = None
        self.space = start

    @property
    def gallery(self) -> Gallery:
        """The labelled windows so far."""
        return self._prepared_gallery.gallery

    def process(
        self, windows: Windows, *, learn: bool, label: str
    ) -> tuple[Projection, Matches | None] | None:
        """Learns from the windows of a frame, then projects and labels them.

        Args:
            windows: of the recipe's patch size.
            learn: whether the space is updated from them.
            label: name under which they join the gallery; "" adds none.

        Returns:
            Their projection, and their labels or None without a gallery; None while there is no space.
        """
        recipe = self.settings.recipe
        prepared = prepare(windows.patches, recipe.preprocessing)
        usable = ~windows.flat & (windows.clipped <= MAX_CLIPPED)
        if learn and not recipe.discriminative:
            # Consecutive frames are similar, and an update per frame would dominate the run time.
            at_most = max(self.settings.batch // FRAMES_PER_BATCH, FIRST_BATCH) if self.space else None
            self.space = self._learner.add(prepared[usable], at_most)
        if label:
            gallery = self.gallery.with_windows(windows.patches[usable], label, self.settings.gallery_limit)
            if gallery is not self.gallery:
                self._prepared_gallery = prepare_gallery(gallery, recipe, self._prepared_gallery)
        if self.space is None:
            return None
        projection = self.space.project(prepared, windows.flat)
        if not self._prepared_gallery.gallery.labels:
            return projection, None
        return projection, self._recognise(projection.vectors, self.space)

    def _recognise(self, vectors: FloatBatch, space: WaveletEigenSpace) -> Matches:
        current = self._recogniser
        if current is None or current.space is not space or current.gallery is not self._prepared_gallery:
            current = self._recogniser = Recogniser(space, self._prepared_gallery)
        return current.recognise(vectors)
