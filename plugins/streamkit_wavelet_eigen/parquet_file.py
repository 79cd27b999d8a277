"""Feature vectors as Apache Parquet, with pyarrow from the extra `parquet`."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_file import (
    COLUMNS,
    ROWS_PER_GROUP,
    SCHEMA,
    FeatureRows,
    VectorLengthChanged,
    length_text,
    partial_path,
)


class ParquetFeatureWriter:
    """Writes rows in groups of 4096: `vector` as a list of fixed length, and the columns of `COLUMNS`.

    Args:
        path: the file; one that is there is replaced by `finish`.

    Raises:
        ImportError: pyarrow is not installed.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        self._path, self._temporary = path, partial_path(path)
        self._writer: Any = None
        self._waiting: list[FeatureRows] = []
        self._length = 0

    def write(self, rows: FeatureRows) -> None:
        """Adds the rows of one frame.

        Raises:
            VectorLengthChanged: they are longer or shorter than those before.
            OSError: there is no room.
        """
        length = rows.vectors.shape[1]
        if self._length and length != self._length:
            raise VectorLengthChanged(length_text(self._length, length))
        self._length = length
        self._waiting.append(rows)
        if sum(len(part.vectors) for part in self._waiting) >= ROWS_PER_GROUP:
            self._write_group()

    def finish(self) -> None:
        """Writes what is left and puts the file in its place.

        Raises:
            OSError: it cannot be written.
        """
        if self._waiting or self._writer is None:
            self._write_group()
        self._writer.close()
        self._temporary.replace(self._path)

    def discard(self) -> None:
        """Closes and removes what has been written so far; nothing after `finish`."""
        if self._writer is not None:
            self._writer.close()
        self._temporary.unlink(missing_ok=True)

    def _write_group(self) -> None:
        arrow = self._arrow
        arrays = {name: self._column(name, kind) for name, kind in COLUMNS.items()}
        vectors = [np.zeros((0, self._length), np.float32), *(part.vectors for part in self._waiting)]
        values = arrow.array(np.concatenate(vectors).astype(np.float32).ravel())
        arrays["vector"] = arrow.FixedSizeListArray.from_arrays(values, max(self._length, 1))
        table = arrow.table(arrays).replace_schema_metadata({"schema": SCHEMA})
        if self._writer is None:
            self._writer = self._parquet.ParquetWriter(self._temporary, table.schema)
        self._writer.write_table(table)
        self._waiting.clear()

    def _column(self, name: str, kind: str) -> Any:
        parts: list[NDArray[Any]] = [np.zeros(0, np.dtype(kind))]
        parts += [part.columns[name] for part in self._waiting]
        values = np.concatenate(parts)
        return (
            self._arrow.array(values.tolist(), self._arrow.string())
            if name == "label"
            else self._arrow.array(values.astype(np.dtype(kind)))
        )
