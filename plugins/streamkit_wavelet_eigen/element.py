"""waveleteigen: appearance features of targets, in an eigenspace learnt from the stream or from a file."""

import os
from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path

import numpy as np

from streamkit import (
    LUMA_CAPS,
    Detections,
    Features,
    FeatureSpace,
    Frame,
    Property,
    ResourceError,
    Transform,
    luma,
    write_remedy,
)
from streamkit_kernels import COMPILING, telling
from streamkit_wavelet_eigen.appearance import Appearance, Settings
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace
from streamkit_wavelet_eigen.gallery import Gallery, empty_gallery
from streamkit_wavelet_eigen.gallery_folder import read_gallery
from streamkit_wavelet_eigen.learner import learn_space
from streamkit_wavelet_eigen.model_file import InvalidModelFile, Model, load_model, save_model
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing, Threshold
from streamkit_wavelet_eigen.recipe import PRESETS, Basis, Metric, Recipe, Views
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.targets import Look, Targets, TargetSource, detected, given, tracked
from streamkit_wavelet_eigen.warm_up import warm_up
from streamkit_wavelet_eigen.windows import cut_windows


class Preset(StrEnum):
    """Recipes that were measured; `custom` leaves the single properties to decide."""

    CUSTOM = "custom"
    PAPER = "paper"
    MODULAR = "modular"
    RECOGNITION = "recognition"


class WaveletEigen(Transform):
    """Attaches a feature vector to each target, and the eigenspace it was made in.

    Windows around detections, tracks (turned by their angle) or a given place are prepared by the wavelet
    steps of the published method, or as `mode` says, and projected on eigenvectors learnt from the stream,
    from a `gallery` or from a saved `model`. A frame passes without features until two windows have been
    seen. With labelled windows each target gets the label of its nearest neighbour. Vectors compare within
    one version of the space only. The published preparation lowers recognition and tracking somewhat;
    `mode=raw` is better for both and ten times as fast.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! waveleteigen components=8 ! fakesink
    """

    sink = src = LUMA_CAPS
    targets: TargetSource = Property(TargetSource.DETECTIONS, doc="What windows are cut around.")
    window: str | None = Property(
        None, unit="px", doc="x,y,w,h[,angle in rad]: one window instead, the same in each frame."
    )
    margin: float = Property(1.25, min=1.0, max=4.0, live=True, doc="Window side over a target's longer one.")
    preset: Preset = Property(
        Preset.CUSTOM, doc="A measured recipe in place of patch .. metric; docs/wavelet-eigen.md lists them."
    )
    patch: int = Property(32, min=8, max=128, unit="px", doc="Side of the prepared windows; even.")
    mode: Mode = Property(
        Mode.PAPER, doc="paper: all five published steps; denoise: without equalising; raw: none of them."
    )
    threshold: Threshold = Property(Threshold.VISU, doc="How the wavelet details are thresholded.")
    wavelet: str = Property("db8", doc="Wavelet, by its PyWavelets name.")
    approximation: int = Property(0, min=0, max=5, doc="Low-pass levels after that; each halves the sides.")
    blocks: int = Property(1, min=1, max=16, doc="Blocks per side with a projection each.")
    basis: Basis = Property(Basis.SHARED, doc="One basis for all blocks, or one per block.")
    components: int = Property(16, min=1, max=256, doc="Eigenvectors for each block.")
    energy: float = Property(
        1.0, min=0.01, max=1.0, doc="Share of variance to hold with as few of them as can be; 1 keeps all."
    )
    discriminative: bool = Property(False, doc="Fisher step on the labels of `gallery`; the space is fixed.")
    views: Views = Property(Views.NONE, doc="Virtual views learnt with each labelled window.")
    metric: Metric = Property(Metric.EUCLIDEAN, doc="How vectors are compared; summed: block by block.")
    batch: int = Property(
        32, min=2, max=1024, doc="Windows per update of the space; a frame gives a quarter."
    )
    forgetting: float = Property(
        0.95, min=0.01, max=1.0, doc="Weight of the past at each update; 1 keeps all."
    )
    learn: bool = Property(True, live=True, doc="Whether the space goes on learning.")
    model: str | None = Property(
        None, doc="File of a saved space and gallery to start from; decides preset .. metric."
    )
    save: str | None = Property(None, doc="File the space and the gallery are written to at the end, .npz.")
    gallery: str | None = Property(
        None, doc="Folder of labelled windows, LABEL/PICTURE; without a model the space is learnt from them."
    )
    label: str = Property("", live=True, doc="While set, windows join the gallery under this name.")
    gallery_limit: int = Property(64, min=1, max=4096, doc="Most windows of one label that are taught so.")
    min_margin: float = Property(
        0.0, min=0.0, max=1.0, live=True, doc="Label only what is nearer than the next label by this share."
    )

    _appearance: Appearance | None = None

    def start(self) -> None:
        """Reads the model and the gallery, and sees that the result can be saved."""
        with telling(lambda: self.post_warning(COMPILING)):
            warm_up()
        self._counts: Counter[str] = Counter()
        self._appearance = None
        model = self._load()
        recipe = model.space.recipe if model else self._recipe()
        recipe.check()
        gallery = model.gallery if model else empty_gallery(recipe.patch)
        start = model.space if model else None
        if self.gallery:
            gallery = self._read_gallery(Path(self.gallery), recipe.patch)
            start = start or self._learnt_from(gallery, recipe)
        self._saved_version = (model.space.version, len(model.gallery)) if model else (0, 0)
        if recipe.discriminative and start is None:
            raise ResourceError(
                "discriminative needs labelled windows: give gallery=FOLDER with a folder of pictures for "
                "each label, or a model that was saved with them"
            )
        if not self.learn and start is None:
            self.post_warning("learn is off and no model is given: frames pass without features")
        if self.save and not os.access(Path(self.save).absolute().parent, os.W_OK):
            raise ResourceError(
                f"save: the folder of {self.save} must exist and be writable; make it or name another file"
            )
        self._look = self._looking()
        settings = Settings(recipe, self.batch, self.forgetting, self.gallery_limit)
        try:
            self._appearance = Appearance(settings, start, gallery)
        except ValueError as error:
            raise ResourceError(f"gallery: {error}") from error

    def transform(self, frame: Frame) -> Frame:
        """Attaches Features and TargetFeatures, where there are targets, and the space they were made in."""
        appearance = self._appearance
        assert appearance is not None, "start() comes before frames"
        targets = self._look(frame)
        if targets is not None:
            frame = self._described(frame, targets, appearance)
        space = appearance.space
        return frame if space is None else frame.attach_as(FeatureSpace, space)

    def _described(self, frame: Frame, targets: Targets, appearance: Appearance) -> Frame:
        windows = cut_windows(luma(frame), targets.places, appearance.patch, self.margin)
        self._counts.update(
            windows=len(windows.flat),
            flat=int(np.count_nonzero(windows.flat)),
            tiny=int(np.count_nonzero(windows.tiny)),
            clipped=int(np.count_nonzero(windows.clipped)),
        )
        seen = appearance.look(windows, learn=self.learn, label=self.label)
        if seen is None or appearance.space is None:
            return frame
        labels: tuple[str, ...] = ()
        distances = margins = np.zeros(0)
        if seen.matches is not None:
            distances, margins = seen.matches.distances, seen.matches.margins
            sure = margins >= self.min_margin
            labels = tuple(name if kept else "" for name, kept in zip(seen.matches.labels, sure, strict=True))
        facts = TargetFeatures(
            targets.kind, targets.ids, targets.places, appearance.space.version,
            windows.flat, windows.clipped, windows.tiny,
            seen.projection.errors, seen.projection.energy, labels, distances, margins,
        )  # fmt: skip
        detections = frame.get(Detections)
        if labels and targets.kind == "detections" and detections is not None:
            frame = frame.attach(
                Detections(
                    detections.centroids, detections.boxes, detections.areas, detections.scores, labels
                )
            )
        return frame.attach(Features(seen.projection.vectors), facts)

    def drain(self) -> Iterable[Frame]:
        """Saves the space, and tells what the windows were like."""
        self._save()
        appearance = self._appearance
        space = appearance.space if appearance else None
        version, rank = (space.version, space.rank) if space else (0, 0)
        labelled = len(appearance.gallery) if appearance else 0
        self.post_message("windows", **self._counts, version=version, rank=rank, labelled=labelled)
        return ()

    def stop(self) -> None:
        """Saves the space if the stream was stopped before its end."""
        self._save()

    @staticmethod
    def _learnt_from(gallery: Gallery, recipe: Recipe) -> WaveletEigenSpace:
        try:
            return learn_space(gallery.patches.astype(np.float32), recipe, gallery.labels)
        except ValueError as error:
            raise ResourceError(f"gallery: {error}") from error

    def _recipe(self) -> Recipe:
        if self.preset is not Preset.CUSTOM:
            return PRESETS[self.preset.value]
        how = Preprocessing(self.mode, self.threshold, self.wavelet, self.approximation)
        return Recipe(
            self.patch, how, self.blocks, self.basis, self.components, self.energy, self.discriminative,
            views=self.views, metric=self.metric,
        )  # fmt: skip

    def _looking(self) -> Look:
        if self.window is not None:
            return given(self.window, self.name)
        return tracked if self.targets is TargetSource.TRACKS else detected

    def _load(self) -> Model | None:
        if self.model is None:
            return None
        try:
            return load_model(Path(self.model))
        except (InvalidModelFile, OSError) as error:
            raise ResourceError(f"model: {error}") from error

    @staticmethod
    def _read_gallery(folder: Path, patch: int) -> Gallery:
        try:
            return read_gallery(folder, patch)
        except (ValueError, OSError) as error:
            raise ResourceError(f"gallery: {error}") from error

    def _save(self) -> None:
        appearance = self._appearance
        space = appearance.space if appearance else None
        if not self.save or appearance is None or space is None:
            return
        state = (space.version, len(appearance.gallery))
        if state == self._saved_version:
            return
        try:
            save_model(Model(space, appearance.gallery), Path(self.save))
        except OSError as error:
            raise ResourceError(
                f"save: {self.save} cannot be written: {error}{write_remedy(error)}"
            ) from error
        self._saved_version = state
