"""Feature vectors as Apache Parquet, with pyarrow from the extra `parquet`."""

from pathlib import Path
from typing import Any

import numpy as np
from typing_extensions import override

from streamkit.output.file import OutputFile
from streamkit_wavelet_eigen.feature_file import COLUMNS, SCHEMA, FeatureWriter

ROWS_PER_GROUP = 4096


class ParquetFeatureWriter(FeatureWriter):
    """Writes groups of 4096 rows: `vector` as a list of fixed length, and the columns of `COLUMNS`.

    Raises:
        ImportError: pyarrow is not installed.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        self._arrow, self._parquet = pyarrow, pyarrow.parquet
        super().__init__(path)

    @override
    def write_file(self, file: OutputFile) -> None:
        columns = {name: self.column(name) for name in self.types}
        writer = None
        for start in range(0, max(self.rows, 1), ROWS_PER_GROUP):
            count = min(ROWS_PER_GROUP, self.rows - start)
            arrays = {name: self._array(columns[name].read(count * np.dtype(kind).itemsize), kind)
                      for name, kind in COLUMNS.items()}  # fmt: skip
            values = self._arrow.array(np.frombuffer(columns["vectors"].read(count * self.length * 4), "<f4"))
            arrays["vector"] = self._arrow.FixedSizeListArray.from_arrays(values, max(self.length, 1))
            table = self._arrow.table(arrays).replace_schema_metadata({"schema": SCHEMA})
            writer = writer or self._parquet.ParquetWriter(file, table.schema)
            writer.write_table(table)
        assert writer is not None
        writer.close()

    def _array(self, data: bytes, kind: str) -> Any:
        values = np.frombuffer(data, np.dtype(kind))
        if kind.startswith("<U"):
            return self._arrow.array(values.tolist(), self._arrow.string())
        return self._arrow.array(values)
