"""What a stream's windows look like: learnt, projected and recognised, frame by frame."""

from dataclasses import dataclass

import numpy as np

from streamkit_wavelet_eigen.feature_space import Projection, WaveletEigenSpace
from streamkit_wavelet_eigen.gallery import Gallery, Matches, Recogniser, prepare_gallery
from streamkit_wavelet_eigen.learner import FIRST_BATCH, SpaceLearner
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.wavelet import FloatBatch
from streamkit_wavelet_eigen.windows import Windows

# A window that is mostly replicated border would teach the space streaks.
CLIPPED_LIMIT = 0.25
# Fewest frames that make a batch, however many targets they have.
FRAMES_PER_BATCH = 4


@dataclass(frozen=True)
class Settings:
    """How a stream is learnt.

    Attributes:
        recipe: how windows become vectors.
        batch: windows per update of the space.
        forgetting: weight of the past at each update.
        gallery_limit: most windows of one label that are taught.
    """

    recipe: Recipe
    batch: int
    forgetting: float
    gallery_limit: int


@dataclass(frozen=True, eq=False)
class Seen:
    """The windows of one frame, in the space of that frame.

    Attributes:
        projection: their vectors, errors and energy.
        matches: their labels, or None without a gallery.
    """

    projection: Projection
    matches: Matches | None


class Appearance:
    """Holds the space, the gallery, and the recogniser that belongs to both.

    A space with a Fisher step is fixed: axes learnt from labels do not fit eigenvectors that move.

    Args:
        settings: how to learn.
        start: a space to begin with, or None.
        gallery: labelled windows; may be empty.

    Raises:
        ValueError: there are too many labelled windows.
    """

    def __init__(self, settings: Settings, start: WaveletEigenSpace | None, gallery: Gallery) -> None:
        self._settings = settings
        self._learner = SpaceLearner(
            settings.recipe, batch=settings.batch, forgetting=settings.forgetting, start=start
        )
        self._known = prepare_gallery(gallery, settings.recipe)
        self._recogniser: Recogniser | None = None

    @property
    def gallery(self) -> Gallery:
        """The labelled windows so far."""
        return self._known.gallery

    @property
    def space(self) -> WaveletEigenSpace | None:
        """The newest space, None before the first."""
        return self._learner.space

    @property
    def patch(self) -> int:
        """Side of the windows, px."""
        return self._settings.recipe.patch

    def look(self, windows: Windows, *, learn: bool, label: str) -> Seen | None:
        """Takes the windows of a frame.

        Args:
            windows: of the patch size.
            learn: whether the space may learn from them.
            label: the name under which they join the gallery, or "".

        Returns:
            What is seen, or None while there is no space.
        """
        prepared = prepare(windows.patches, self._settings.recipe.preprocessing)
        usable = ~windows.flat & (windows.clipped <= CLIPPED_LIMIT)
        if learn and not self._settings.recipe.discriminative:
            self._learner.add(self._share(prepared[usable]))
        if label:
            gallery = self.gallery.joined(windows.patches[usable], label, self._settings.gallery_limit)
            self._known = self._known.grown(gallery, self._settings.recipe)
        space = self._learner.space
        if space is None:
            return None
        projection = space.project(prepared, np.asarray(windows.flat))
        recogniser = self._current(space)
        matches = recogniser.recognise(projection.vectors) if recogniser else None
        return Seen(projection, matches)

    def _share(self, prepared: FloatBatch) -> FloatBatch:
        """What one frame teaches: all before there is a space, then evenly spaced at most a part of a batch.

        Windows of neighbouring frames show much the same; an update for every frame of a crowd would take
        longer than everything else.
        """
        most = max(self._settings.batch // FRAMES_PER_BATCH, FIRST_BATCH)
        if self._learner.space is None or len(prepared) <= most:
            return prepared
        chosen: FloatBatch = prepared[np.linspace(0, len(prepared) - 1, most).round().astype(int)]
        return chosen

    def _current(self, space: WaveletEigenSpace) -> Recogniser | None:
        """The recogniser of this space and gallery; a new one when either has changed."""
        if not len(self.gallery):
            return None
        current = self._recogniser
        if current is None or current.space is not space or current.known is not self._known:
            self._recogniser = Recogniser(space, self._known)
        return self._recogniser
