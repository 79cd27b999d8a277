"""Files of feature vectors, npz or parquet, in memory that does not grow with the stream."""

import io
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit.output.file import OutputFile

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


class VectorLengthChanged(ValueError):
    """The length of the vectors differs from that of earlier rows."""


def empty_rows(count: int, length: int) -> Rows:
    """Rows with the fields `vectors` float32[length] and `COLUMNS`, all zero or ""."""
    return np.zeros(count, [("vectors", "<f4", (length,)), *COLUMNS.items()])


class FeatureWriter:
    """Collects rows in a temporary file, of which the whole file is made each time it is saved.

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
            VectorLengthChanged: their vectors have another length than those before.
            OSError: they cannot be written.
        """
        length, before = rows.dtype["vectors"].shape[0], self._row_type["vectors"].shape[0]
        if self.count and length != before:
            raise VectorLengthChanged(
                f"vectors of one file must have one length, got {length} values after {before}; "
                "write a file for each feature space"
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
