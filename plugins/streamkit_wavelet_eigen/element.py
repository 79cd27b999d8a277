"""waveleteigen: appearance features of detections, in an eigenspace learnt from the stream itself."""

import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

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
)
from streamkit_wavelet_eigen.feature_space import InvalidSpaceFile, WaveletEigenSpace, load_space, save_space
from streamkit_wavelet_eigen.learner import SpaceLearner
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing, Threshold, prepare
from streamkit_wavelet_eigen.windows import Windows, cut_windows

# A window that is mostly replicated border would teach the space streaks.
CLIPPED_LIMIT = 0.25


class WaveletEigen(Transform):
    """Attaches a feature vector to each detection, and the eigenspace it was made in.

    Windows around the detections are prepared by the wavelet steps of the published method, or as `mode`
    says, and projected on eigenvectors learnt from the stream. A frame passes without features until two
    windows have been seen. Vectors compare within one version of the space only. The published preparation
    lowers recognition and tracking somewhat; `mode=raw` is better for both and ten times as fast.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! waveleteigen components=8 ! fakesink
    """

    sink = src = LUMA_CAPS
    patch: int = Property(32, min=8, max=128, unit="px", doc="Side of the prepared windows; even.")
    margin: float = Property(1.25, min=1.0, max=4.0, live=True, doc="Window side over the box's longer side.")
    mode: Mode = Property(
        Mode.PAPER, doc="paper: all five published steps; denoise: without equalising; raw: none of them."
    )
    threshold: Threshold = Property(Threshold.VISU, doc="How the wavelet details are thresholded.")
    wavelet: str = Property("db8", doc="Orthogonal wavelet, by its PyWavelets name.")
    components: int = Property(16, min=1, max=256, doc="Eigenvectors, and the length of a feature vector.")
    batch: int = Property(32, min=2, max=1024, doc="Windows per update of the space.")
    forgetting: float = Property(
        0.95, min=0.01, max=1.0, doc="Weight of the past at each update; 1 keeps all."
    )
    learn: bool = Property(True, live=True, doc="Whether the space goes on learning.")
    model: str | None = Property(
        None, doc="File of a saved space to start from; decides patch, preparation and components."
    )
    save: str | None = Property(None, doc="File the space is written to at the end, .npz.")

    _learner: SpaceLearner | None = None

    def start(self) -> None:
        """Reads the model and sees that the result can be saved."""
        self._counts: Counter[str] = Counter()
        self._learner = None
        start = self._load(Path(self.model)) if self.model else None
        self._saved_version = start.version if start else 0
        self._patch = start.patch_size[0] if start else self.patch
        self._preprocessing = (
            start.preprocessing if start else Preprocessing(self.mode, self.threshold, self.wavelet)
        )
        self._preprocessing.check((self._patch, self._patch))
        self._learner = SpaceLearner(
            patch=self._patch,
            components=start.components if start else min(self.components, self._patch**2),
            batch=self.batch,
            forgetting=self.forgetting,
            preprocessing=self._preprocessing,
            start=start,
        )
        if not self.learn and start is None:
            self.post_warning("learn is off and no model is given: frames pass without features")
        if self.save and not os.access(Path(self.save).absolute().parent, os.W_OK):
            raise ResourceError(
                f"save: the folder of {self.save} must exist and be writable; make it or name another file"
            )

    def transform(self, frame: Frame) -> Frame:
        """Attaches Features, where there are detections, and the space they were made in."""
        assert self._learner is not None, "start() comes before frames"
        detections, space = frame.get(Detections), self._learner.space
        if detections is not None and len(detections):
            windows = cut_windows(
                luma(frame), detections.centroids, detections.boxes, self._patch, self.margin
            )
            self._count(windows)
            prepared = prepare(windows.patches, self._preprocessing)
            if self.learn:
                space = self._learner.add(prepared[~windows.flat & (windows.clipped <= CLIPPED_LIMIT)])
            if space is not None:
                frame = frame.attach(Features(space.project(prepared, windows.flat)))
        return frame if space is None else frame.attach_as(FeatureSpace, space)

    def drain(self) -> Iterable[Frame]:
        """Saves the space, and tells what the windows were like."""
        self._save()
        space = self._learner.space if self._learner else None
        version, rank = (space.version, space.space.rank) if space else (0, 0)
        self.post_message("windows", **self._counts, version=version, rank=rank)
        return ()

    def stop(self) -> None:
        """Saves the space if the stream was stopped before its end."""
        self._save()

    def _count(self, windows: Windows) -> None:
        self._counts["windows"] += len(windows.flat)
        self._counts["flat"] += int(windows.flat.sum())
        self._counts["tiny"] += int(windows.tiny.sum())
        self._counts["clipped"] += int((windows.clipped > 0).sum())

    def _load(self, path: Path) -> WaveletEigenSpace:
        try:
            space = load_space(path)
        except (InvalidSpaceFile, OSError) as error:
            raise ResourceError(f"model: {error}") from error
        if space.patch_size[0] != space.patch_size[1]:
            raise ResourceError(f"model: {path} must be made of square windows, got {space.patch_size}")
        return space

    def _save(self) -> None:
        space = self._learner.space if self._learner else None
        if not self.save or space is None or space.version == self._saved_version:
            return
        try:
            save_space(space, Path(self.save))
        except OSError as error:
            raise ResourceError(f"save: {self.save} cannot be written: {error}") from error
        self._saved_version = space.version
