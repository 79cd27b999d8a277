"""Appearance of the targets in a stream: learns a feature space, projects windows into it and labels them."""

from dataclasses import dataclass, field

from streamkit.settings import setting
from streamkit_wavelet_eigen.feature_space import Projection, WaveletEigenSpace
from streamkit_wavelet_eigen.gallery import Gallery, Matches, Recogniser, prepare_gallery
from streamkit_wavelet_eigen.learner import FIRST_BATCH, SpaceLearner
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Recipe
from streamkit_wavelet_eigen.wavelet import FloatBatch
from streamkit_wavelet_eigen.windows import Windows

# A window with more replicated border than this would teach the space streaks.
MAX_CLIPPED = 0.25
# Fewest frames that make up a batch, whatever their number of targets.
FRAMES_PER_BATCH = 4


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
            self._prepared_gallery = self._prepared_gallery.extended(gallery, recipe)
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
