"""featuresink: the feature vectors of each frame as rows of a file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit import (
    Detections,
    Features,
    FeatureSpace,
    Frame,
    Property,
    ResourceError,
    Sink,
    StreamError,
    write_remedy,
)
from streamkit_wavelet_eigen.feature_file import (
    LABEL_CHARACTERS,
    FeatureRows,
    FeatureWriter,
    NpzFeatureWriter,
    VectorLengthChanged,
)
from streamkit_wavelet_eigen.parquet_file import ParquetFeatureWriter
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.windows import box_places

# What `pts_ns` has for a frame without a time.
NO_TIME = np.iinfo(np.int64).min


class FeatureSink(Sink):
    """Writes one row per feature vector: the frame's numbers, the target's place, and the vector.

    The name's end decides the form: `.npz`, or `.parquet` with the extra of that name. The file is complete
    at the end of the stream; one that is stopped before keeps the rows so far. Vectors of any feature space
    are taken, not only those of waveleteigen.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! waveleteigen ! featuresink location=features.npz
    """

    sink = "video/x-raw"
    location: str = Property("", doc="File to write, .npz or .parquet; one that is there is replaced.")

    _writer: FeatureWriter | None = None

    def start(self) -> None:
        """Prepares the file."""
        self._writer = None
        path = Path(self.location)
        forms: dict[str, Callable[[Path], FeatureWriter]] = {
            ".npz": NpzFeatureWriter,
            ".parquet": ParquetFeatureWriter,
        }
        if path.suffix not in forms:
            raise ResourceError(
                f"location must end in .npz or .parquet, got {self.location!r}; "
                "write for example location=features.npz"
            )
        try:
            self._writer = forms[path.suffix](path)
        except ImportError as error:
            raise ResourceError(
                f"location={self.location}: parquet needs pyarrow; install streamkit[parquet] or write .npz"
            ) from error
        except OSError as error:
            raise self._unwritten(error) from error

    def render(self, frame: Frame) -> None:
        """Takes the frame's vectors, if it has any."""
        assert self._writer is not None, "start() comes before frames"
        features = frame.get(Features)
        if features is None or not len(features.vectors):
            return
        try:
            self._writer.write(rows_of(frame, features.vectors))
        except VectorLengthChanged as error:
            raise StreamError(f"location={self.location}: {error}") from error
        except OSError as error:
            raise self._unwritten(error) from error

    def drain(self) -> None:
        """Completes the file."""
        self._finish()

    def stop(self) -> None:
        """Completes the file of a stream that was stopped before its end."""
        self._finish()

    def _finish(self) -> None:
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.finish()
        except OSError as error:
            raise self._unwritten(error) from error
        finally:
            writer.discard()

    def _unwritten(self, error: OSError) -> ResourceError:
        return ResourceError(
            f"location={self.location}: cannot be written: {error.strerror or error}{write_remedy(error)}"
        )


def rows_of(frame: Frame, vectors: NDArray[np.float32]) -> FeatureRows:
    """The rows of one frame; what its metadata does not tell is NaN, "" or the row's number."""
    count = len(vectors)
    facts, space = frame.get(TargetFeatures), frame.metadata.get(FeatureSpace)
    told = facts is not None and len(facts.ids) == count
    places = facts.places if facts is not None and told else _detected_places(frame, count)
    version = getattr(space, "version", 0)
    numbers: dict[str, Any] = {
        "seq": frame.seq, "epoch": frame.epoch,
        "pts_ns": NO_TIME if frame.pts is None else frame.pts, "version": version,
    }  # fmt: skip
    columns = {name: np.full(count, value) for name, value in numbers.items()}
    columns |= dict(zip(("x", "y", "length", "width", "angle"), places.T, strict=True))
    if facts is not None and told:
        labels = facts.labels or ("",) * count
        columns |= {"id": facts.ids, "flat": facts.flat, "clipped": facts.clipped, "error": facts.errors}
    else:
        labels = ("",) * count
        columns |= {"id": np.arange(count), "flat": ~np.any(vectors != 0, axis=1)}
        columns |= {"clipped": np.full(count, np.nan), "error": np.full(count, np.nan)}
    columns["label"] = np.array([label[:LABEL_CHARACTERS] for label in labels])
    return FeatureRows(vectors, columns)


def _detected_places(frame: Frame, count: int) -> NDArray[np.float64]:
    detections = frame.get(Detections)
    if detections is None or len(detections) != count:
        return np.full((count, 5), np.nan)
    return box_places(detections.centroids, detections.boxes)
