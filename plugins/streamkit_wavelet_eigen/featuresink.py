"""featuresink: writes feature vectors to a file."""

import time

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import (
    Detections,
    Features,
    FeatureSpace,
    Frame,
    OutputFileSink,
    ResourceError,
    StreamError,
)
from streamkit_wavelet_eigen.feature_file import (
    FeatureWriter,
    Rows,
    VectorLengthChanged,
    empty_rows,
    load_parquet,
)
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.windows import rotated_boxes

# `pts_ns` of a frame without a time.
NO_TIME = np.iinfo(np.int64).min
SAVE_S = 1.0
SAVING_SHARE = 0.05  # of one processor, for files that take long to save


class FeatureSink(OutputFileSink):
    """Writes one row per feature vector: frame numbers, the target's box, and the vector.

    The suffix of the file decides the format: `.npz`, or `.parquet` with the extra of that name. The whole
    file is saved once a second, large ones less often. Vectors of any feature space are written, not only
    those of waveleteigen.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! waveleteigen ! featuresink location=features.npz
    """

    sink = "video/x-raw"
    suffixes = (".npz", ".parquet")
    example = "features.npz"

    _writer: FeatureWriter | None = None

    @override
    def start(self) -> None:
        self._writer = None
        super().start()
        try:
            if self.location.lower().endswith(".parquet"):
                load_parquet()  # here, as it would delay the first save
        except ImportError as error:
            raise ResourceError(
                f"location={self.location}: parquet needs pyarrow; install streamkit[parquet] or write .npz"
            ) from error

    @override
    def begin(self) -> None:
        self._writer = FeatureWriter(self.next_path())
        self._due_s = 0.0

    @override
    def write(self, frame: Frame) -> None:
        assert self._writer is not None, "begin() comes before frames"
        features = frame.get(Features)
        if features is None or not len(features.vectors):
            return
        try:
            self._writer.write(feature_rows(frame, features.vectors))
        except VectorLengthChanged as error:
            raise StreamError(f"location={self.location}: {error}") from error
        if time.monotonic() >= self._due_s:
            # The processor's time: on a busy machine a small file is saved as often.
            began_s = time.thread_time()
            self._writer.save()
            self._due_s = time.monotonic() + max(SAVE_S, (time.thread_time() - began_s) / SAVING_SHARE)

    @override
    def end(self) -> None:
        assert self._writer is not None, "begin() comes before the end"
        self._writer.finish()

    @override
    def shortfall(self) -> str:
        has_rows = self._writer is not None and self._writer.count
        return "" if has_rows else "no frame carried features of a target; put waveleteigen before it"

    @override
    def abandon(self) -> None:
        if self._writer is not None:
            self._writer.close()


def feature_rows(frame: Frame, vectors: NDArray[np.float32]) -> Rows:
    """The rows of a frame; values missing in its metadata are NaN, "" or the row's number."""
    count, details = len(vectors), frame.get(TargetFeatures)
    if details is not None and len(details.ids) != count:
        details = None
    rows = empty_rows(count, vectors.shape[1])
    rows["vectors"] = vectors
    rows["seq"], rows["epoch"] = frame.seq, frame.epoch
    rows["pts_ns"] = NO_TIME if frame.pts is None else frame.pts
    rows["version"] = getattr(frame.metadata.get(FeatureSpace), "version", 0)
    boxes = _detected_boxes(frame, count) if details is None else details.boxes
    for name, values in zip(("x", "y", "length", "width", "angle"), boxes.T, strict=True):
        rows[name] = values
    if details is None:
        rows["id"], rows["flat"] = np.arange(count), ~np.any(vectors != 0, axis=1)
        rows["clipped"] = rows["error"] = np.nan
        return rows
    rows["id"], rows["flat"] = details.ids, details.flat
    rows["clipped"], rows["error"] = details.clipped, details.errors
    if details.labels:
        rows["label"] = details.labels
    return rows


def _detected_boxes(frame: Frame, count: int) -> NDArray[np.float64]:
    detections = frame.get(Detections)
    if detections is None or len(detections) != count:
        return np.full((count, 5), np.nan)
    return rotated_boxes(detections.centroids, detections.boxes)
