"""Appearance of the targets in a stream: learns a feature space, projects windows into it and labels them."""

from dataclasses import dataclass, field

import numpy as np

from streamkit.settings import setting
from streamkit_wavelet_eigen.eigenspace import learn_eigenspace, update_eigenspace
from streamkit_wavelet_eigen.feature_space import Projection, WaveletEigenSpace, vectors_by_space
from streamkit_wavelet_eigen.gallery import Gallery, Matches, Recogniser
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

    Two windows give the first space, so that a stream has features from its start. From then on `batch`
    windows are collected, and update it together. No call gives more than completes a batch.

    Args:
        settings: recipe (without a Fisher step), batch and forgetting.
        start: initial space, or None.

    Attributes:
        space: the newest space; None before the first.
    """

    def __init__(self, settings: AppearanceSettings, start: WaveletEigenSpace | None = None) -> None:
        self.space = start
        self._settings = settings
        self._extended = start.spaces if start else ()  # those of `space`, with `EXTRA_COMPONENTS`
        self._collected: list[FloatBatch] = []

    def add(self, prepared: FloatBatch) -> WaveletEigenSpace | None:
        """Adds windows float32[n, h, w], a selection of more than complete a batch; returns the space."""
        batch = self._settings.batch
        self._collected.extend(
            window.copy() for window in even_selection(prepared, batch - len(self._collected))
        )
        if len(self._collected) >= (FIRST_BATCH if self.space is None else batch):
            self.space = self._updated(np.stack(self._collected))
            self._collected.clear()
        return self.space

    def _updated(self, prepared: FloatBatch) -> WaveletEigenSpace:
        recipe, before = self._settings.recipe, self.space
        components = min(recipe.components + EXTRA_COMPONENTS, recipe.block_values)
        batches = vectors_by_space(prepared, recipe)
        if before is None:
            self._extended = tuple(learn_eigenspace(vectors, components) for vectors in batches)
        else:
            self._extended = tuple(
                update_eigenspace(space, vectors, components, self._settings.forgetting)
                for space, vectors in zip(self._extended, batches, strict=True)
            )
        spaces = tuple(space.truncated(recipe.components, recipe.energy) for space in self._extended)
        return WaveletEigenSpace(spaces, recipe, before.version + 1 if before else 1)


def even_selection(windows: FloatBatch, limit: int) -> FloatBatch:
    """At most `limit` windows, evenly from the first to the last."""
    if len(windows) <= limit:
        return windows
    selection: FloatBatch = windows[np.linspace(0, len(windows) - 1, limit).round().astype(int)]
    return selection


class AppearanceModel:
    """The feature space, the gallery, and the recogniser that belongs to both.

    A space with a Fisher step is fixed: axes learnt from labels do not fit eigenvectors that change.

    Args:
        settings: how to learn.
        start: initial space, or None.
        gallery: labelled windows; may be empty.

    Attributes:
        learner: has the newest space.

    Raises:
        ValueError: there are too many labelled windows.
    """

    def __init__(
        self, settings: AppearanceSettings, start: WaveletEigenSpace | None, gallery: Gallery
    ) -> None:
        self.settings = settings
        self.learner = SpaceLearner(settings, start)
        self._recogniser = Recogniser(settings.recipe, gallery)

    @property
    def gallery(self) -> Gallery:
        """The labelled windows so far."""
        return self._recogniser.gallery

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
            learnt = prepared[usable]
            if self.learner.space is not None:
                # Consecutive frames are similar, and an update per frame would dominate the run time.
                learnt = even_selection(learnt, max(self.settings.batch // FRAMES_PER_BATCH, FIRST_BATCH))
            self.learner.add(learnt)
        if label:
            gallery = self.gallery.with_windows(windows.patches[usable], label, self.settings.gallery_limit)
            if gallery is not self.gallery:
                self._recogniser.extend(gallery)
        space = self.learner.space
        if space is None:
            return None
        projection = space.project(prepared, windows.flat)
        if not self._recogniser.gallery.labels:
            return projection, None
        return projection, self._recogniser.recognise(projection.vectors, space)
