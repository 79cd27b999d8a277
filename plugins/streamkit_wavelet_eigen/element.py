"""waveleteigen: appearance features of targets, in an eigenspace learnt from the stream or from a file."""

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import (
    LUMA_CAPS,
    Detections,
    Features,
    FeatureSpace,
    Frame,
    Property,
    PropertyError,
    ResourceError,
    SettingsOf,
    Transform,
    luma,
    write_remedy,
)
from streamkit.geometry.boxes import parse_turned_box
from streamkit.output.file import check_writable
from streamkit_wavelet_eigen.appearance import AppearanceModel, AppearanceSettings
from streamkit_wavelet_eigen.feature_space import learn_space
from streamkit_wavelet_eigen.gallery import empty_gallery, read_gallery
from streamkit_wavelet_eigen.model_file import Model, load_model, save_model
from streamkit_wavelet_eigen.recipe import PRESETS
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.windows import cut_windows, rotated_boxes


class TargetSource(StrEnum):
    """What windows are cut around."""

    DETECTIONS = "detections"
    TRACKS = "tracks"


class Preset(StrEnum):
    """Measured recipes; `custom` takes the single properties."""

    CUSTOM = "custom"
    PAPER = "paper"
    MODULAR = "modular"
    RECOGNITION = "recognition"


class WaveletEigen(Transform):
    """Attaches a feature vector to each target, and the feature space of the vectors.

    Windows around detections, tracks (rotated by their angle) or a fixed box are preprocessed by the wavelet
    steps of the published method, or as `mode` says, and projected on eigenvectors learnt from the stream,
    from a `gallery` or from a saved `model`. Frames have no features until two windows have been seen. With
    labelled windows each target gets the label of its nearest neighbour. Vectors compare within one version
    of the space only. The published preprocessing lowers recognition and tracking accuracy somewhat;
    `mode=raw` is better for both and ten times as fast.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! waveleteigen components=8 ! fakesink
    """

    sink = src = LUMA_CAPS
    targets: TargetSource = Property(TargetSource.DETECTIONS, doc="What windows are cut around.")
    window: str | None = Property(
        None, unit="px", doc="x,y,w,h[,angle in rad]: one fixed window in each frame instead."
    )
    margin: float = Property(1.25, min=1.0, max=4.0, live=True, doc="Window side over a target's longer one.")
    preset: Preset = Property(
        Preset.CUSTOM, doc="A measured recipe in place of patch, mode .. metric; see docs/wavelet-eigen.md."
    )
    settings = SettingsOf(AppearanceSettings)
    learn: bool = Property(True, live=True, doc="Whether the space is updated from the stream.")
    model: str | None = Property(
        None,
        file="read",
        doc="File of a saved space and gallery to start from; decides preset, patch, mode .. metric.",
    )
    save: str | None = Property(
        None,
        file="write",
        doc="File to write the space and the gallery to at the end, .npz; missing folders are made.",
    )
    gallery: str | None = Property(
        None, doc="Folder of labelled windows, LABEL/IMAGE; without a model the space is learnt from them."
    )
    label: str = Property("", live=True, doc="While set, windows are added to the gallery with this label.")
    min_margin: float = Property(
        0.0, min=0.0, max=1.0, live=True, doc="Least relative distance to the next label for a label."
    )

    _appearance: AppearanceModel | None = None

    @override
    def start(self) -> None:
        self._counts: Counter[str] = Counter()
        self._appearance = None
        try:
            self._window = None if self.window is None else parse_turned_box(self.window)[None]
        except ValueError as error:
            raise PropertyError(f"{self.name}: property window {error}") from error
        settings, model = self._initial_settings()
        recipe = settings.recipe
        recipe.check()
        gallery, space = (model.gallery, model.space) if model else (empty_gallery(recipe.patch), None)
        self._saved_state = (space.version, len(gallery)) if space else (0, 0)
        if self.gallery:
            with _resource("gallery"):
                gallery = read_gallery(Path(self.gallery), recipe.patch)
                space = space or learn_space(gallery.patches.astype(np.float32), recipe, gallery.labels)
        if recipe.discriminative and space is None:
            raise ResourceError(
                "discriminative needs labelled windows: give gallery=FOLDER with a folder of images for "
                "each label, or a model that was saved with them"
            )
        if not self.learn and space is None:
            self.post_warning("learn is off and no model is given: frames pass without features")
        if self.save:
            with _resource("save"):
                check_writable(Path(self.save))
        with _resource("gallery"):
            self._appearance = AppearanceModel(settings, space, gallery)

    @override
    def transform(self, frame: Frame) -> Frame:
        appearance = self._appearance
        assert appearance is not None, "start() comes before frames"
        targets = self._targets_of(frame)
        if len(targets[2]):
            frame = self._with_features(frame, *targets, appearance)
        space = appearance.learner.space
        return frame if space is None else frame.attach_as(FeatureSpace, space)

    def _with_features(
        self,
        frame: Frame,
        kind: str,
        ids: NDArray[np.int64],
        boxes: NDArray[np.float64],
        appearance: AppearanceModel,
    ) -> Frame:
        windows = cut_windows(luma(frame), boxes, appearance.settings.recipe.patch, self.margin)
        self._counts.update(
            windows=len(windows.flat),
            flat=int(np.count_nonzero(windows.flat)),
            tiny=int(np.count_nonzero(windows.tiny)),
            clipped=int(np.count_nonzero(windows.clipped)),
        )
        processed = appearance.process(windows, learn=self.learn, label=self.label)
        if processed is None or appearance.learner.space is None:
            return frame
        projection, matches = processed
        labels: tuple[str, ...] = ()
        distances = margins = np.zeros(0)
        if matches is not None:
            distances, margins = matches.distances, matches.margins
            names = zip(matches.labels, margins >= self.min_margin, strict=True)
            labels = tuple(name if is_certain else "" for name, is_certain in names)
        details = TargetFeatures(
            kind, ids, boxes, appearance.learner.space.version,
            windows.flat, windows.clipped, windows.tiny,
            projection.errors, projection.energy, labels, distances, margins,
        )  # fmt: skip
        detections = frame.get(Detections)
        if labels and kind == TargetSource.DETECTIONS and detections is not None:
            frame = frame.attach(dataclasses.replace(detections, labels=labels))
        return frame.attach(Features(projection.vectors), details)

    @override
    def drain(self) -> Iterable[Frame]:
        self._save()
        appearance = self._appearance
        space = appearance.learner.space if appearance else None
        version, rank = (space.version, space.rank) if space else (0, 0)
        labelled = len(appearance.gallery) if appearance else 0
        self.post_message("windows", **self._counts, version=version, rank=rank, labelled=labelled)
        return ()

    @override
    def stop(self) -> None:
        self._save()

    def _initial_settings(self) -> tuple[AppearanceSettings, Model | None]:
        """The settings, their recipe from the model or the preset where there is one, and the model."""
        settings = self.settings
        if self.model is not None:
            with _resource("model"):
                model = load_model(Path(self.model))
            return dataclasses.replace(settings, recipe=model.space.recipe), model
        if self.preset is not Preset.CUSTOM:
            settings = dataclasses.replace(settings, recipe=PRESETS[self.preset.value])
        return settings, None

    def _targets_of(self, frame: Frame) -> tuple[str, NDArray[np.int64], NDArray[np.float64]]:
        """The fixed window, or the frame's tracks or detections; as in `TargetFeatures`."""
        if self._window is not None:
            return "window", np.zeros(1, np.int64), self._window
        if self.targets is TargetSource.TRACKS:
            rows = [track.turned_box for track in frame.tracks]
            ids = np.array([one.id for one in frame.tracks], np.int64)
            return TargetSource.TRACKS.value, ids, np.array(rows, np.float64)
        detections = frame.get(Detections)
        boxes = np.zeros((0, 5))
        if detections is not None:
            boxes = rotated_boxes(detections.centroids, detections.boxes)
        return TargetSource.DETECTIONS.value, np.arange(len(boxes)), boxes

    def _save(self) -> None:
        appearance = self._appearance
        space = appearance.learner.space if appearance else None
        if not self.save or appearance is None or space is None:
            return
        state = (space.version, len(appearance.gallery))
        if state == self._saved_state:
            return
        try:
            save_model(Model(space, appearance.gallery), Path(self.save))
        except OSError as error:
            raise ResourceError(
                f"save: {self.save} cannot be written: {error}{write_remedy(error)}"
            ) from error
        self._saved_state = state


@contextmanager
def _resource(name: str) -> Iterator[None]:
    """Reports errors of a file or folder under the name of its property."""
    try:
        yield
    except FileNotFoundError as error:
        raise ResourceError(f"{name}: {error.filename}: {error.strerror}; check the path") from error
    except (ValueError, OSError) as error:
        raise ResourceError(f"{name}: {error}") from error
