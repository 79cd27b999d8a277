"""featuresink: writes feature vectors to a file, in memory that does not grow with the stream."""

import io
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import (
    NO_TIME,
    Detections,
    Features,
    FeatureSpace,
    Frame,
    OutputFileSink,
    StreamError,
    needs_extra,
)
from streamkit.output.file import OutputFile
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.windows import rotated_boxes

SAVE_S = 1.0
SAVING_SHARE = 0.05  # of one processor, for files that take long to save
SCHEMA = "streamkit.features/1"
# Columns of an array have a fixed width; longer labels are cut.
LABEL_CHARACTERS = 64
ROWS_PER_GROUP = 4096

# Columns other than `vectors`, with their element types.
COLUMNS: dict[str, str] = {
    "seq": "<i8", "epoch": "<i8", "pts_ns": "<i8", "version": "<i8", "id": "<i8",
    "x": "<f8", "y": "<f8", "length": "<f8", "width": "<f8", "angle": "<f8",
    "flat": "|b1", "clipped": "<f8", "error": "<f4", "label": f"<U{LABEL_CHARACTERS}",
}  # fmt: skip
Rows = NDArray[np.void]


def empty_rows(count: int, length: int) -> Rows:
    """Rows with the fields `vectors` float32[length] and `COLUMNS`, all zero or ""."""
    return np.zeros(count, [("vectors", "<f4", (length,)), *COLUMNS.items()])


class FeatureWriter:
    """Collects rows in a temporary file; each save makes the whole file of it.

    An npz file has an array for each column. A parquet file has groups of 4096 rows, and `vector` is a list
    of fixed length.

    Args:
        path: the file, .npz or .parquet; its folder is made, an existing file is replaced by `save`.

    Attributes:
        count: number of rows.

    Raises:
        OSError: the folder takes no files.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.count = 0
        self._row_type = empty_rows(0, 0).dtype
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
        self._file = tempfile.TemporaryFile(dir=path.absolute().parent)  # noqa: SIM115  closed by `close`

    def write(self, rows: Rows) -> None:
        """Appends the rows of a frame, made by `empty_rows`.

        Raises:
            StreamError: their vectors have another length than those before.
            OSError: they cannot be written.
        """
        length, before = rows.dtype["vectors"].shape[0], self._row_type["vectors"].shape[0]
        if self.count and length != before:
            raise StreamError(
                f"location={self._path}: vectors of one file must have one length, got {length} values after "
                f"{before}; write a file for each feature space"
            )
        self._row_type = rows.dtype
        self._file.write(rows.tobytes())
        self.count += len(rows)

    def save(self) -> None:
        """Makes the file of all rows so far; raises OSError where it cannot be written."""
        self._file.flush()
        rows: Rows = np.empty(0, self._row_type)
        if self.count:  # an empty file cannot be mapped
            rows = np.memmap(self._file, self._row_type, "r", shape=(self.count,))
        file = OutputFile(self._path, is_whole=True)
        try:
            if self._path.suffix.lower() == ".parquet":
                _write_parquet(file, rows)
            else:
                columns = {name: rows[name] for name in self._row_type.names or ()}
                np.savez(file, allow_pickle=False, schema=np.array(SCHEMA), **columns)
            file.finish()
        finally:
            file.discard()

    def finish(self) -> None:
        """Saves the file for the last time."""
        try:
            self.save()
        finally:
            self.close()

    def close(self) -> None:
        """Removes the temporary file."""
        self._file.close()


def load_parquet() -> None:
    """Loads what parquet files need, by writing one row; raises ImportError without pyarrow."""
    _write_parquet(io.BytesIO(), empty_rows(1, 1))


def _write_parquet(file: io.IOBase, rows: Rows) -> None:
    """Needs pyarrow, from the extra `parquet`."""
    import pyarrow.parquet

    groups = _groups(rows)
    first = next(groups)
    with pyarrow.parquet.ParquetWriter(file, first.schema) as writer:
        writer.write_table(first)
        for group in groups:
            writer.write_table(group)


def _groups(rows: Rows) -> Iterator[Any]:
    """Tables of 4096 rows; an empty one if there are no rows."""
    import pyarrow

    length = rows.dtype["vectors"].shape[0]
    for start in range(0, max(len(rows), 1), ROWS_PER_GROUP):
        group = rows[start : start + ROWS_PER_GROUP]
        columns = {name: pyarrow.array(np.ascontiguousarray(group[name])) for name in COLUMNS}
        values = pyarrow.array(group["vectors"].ravel())
        columns["vector"] = pyarrow.FixedSizeListArray.from_arrays(values, max(length, 1))
        yield pyarrow.table(columns).replace_schema_metadata({"schema": SCHEMA})


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
        if self.location.lower().endswith(".parquet"):
            with needs_extra(f"location={self.location}", "parquet"):
                load_parquet()  # here, as it would delay the first save

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
        self._writer.write(feature_rows(frame, features.vectors))
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
