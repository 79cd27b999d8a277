"""Feature vectors as Apache Parquet, with pyarrow from the extra `parquet`."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit_wavelet_eigen.feature_file import COLUMNS, ROWS_PER_GROUP, SCHEMA, FeatureRows, FeatureWriter


class ParquetFeatureWriter(FeatureWriter):
    """Writes groups of 4096 rows: `vector` as a list of fixed length, and the columns of `COLUMNS`.

    Raises:
        ImportError: pyarrow is not installed.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        super().__init__(path)
        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        self._writer: Any = None
        self._pending: list[FeatureRows] = []

    @override
    def _append(self, rows: FeatureRows) -> None:
        self._pending.append(rows)
        if sum(len(part.vectors) for part in self._pending) >= ROWS_PER_GROUP:
            self._write_group()

    @override
    def finish(self) -> None:
        if self._pending or self._writer is None:
            self._write_group()
        self._writer.close()
        self._temporary.replace(self._path)

    @override
    def discard(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._temporary.unlink(missing_ok=True)

    def _write_group(self) -> None:
        arrow, length = self._arrow, self._length or 0
        arrays = {name: self._column(name, kind) for name, kind in COLUMNS.items()}
        vectors = [np.zeros((0, length), np.float32), *(part.vectors for part in self._pending)]
        values = arrow.array(np.concatenate(vectors).astype(np.float32).ravel())
        arrays["vector"] = arrow.FixedSizeListArray.from_arrays(values, max(length, 1))
        table = arrow.table(arrays).replace_schema_metadata({"schema": SCHEMA})
        if self._writer is None:
            self._writer = self._parquet.ParquetWriter(self._temporary, table.schema)
        self._writer.write_table(table)
        self._pending.clear()

    def _column(self, name: str, kind: str) -> Any:
        parts: list[NDArray[Any]] = [np.zeros(0, np.dtype(kind))]
        values = np.concatenate(parts + [part.columns[name] for part in self._pending])
        if name == "label":
            return self._arrow.array(values.tolist(), self._arrow.string())
        return self._arrow.array(values.astype(np.dtype(kind)))
