"""Files of feature vectors, npz or parquet, in memory that does not grow with the stream.

npz needs the number of rows before the first, so that columns are collected in temporary files; parquet is
written in groups of rows. An existing file is replaced when the new one is complete.
"""

import os
import tempfile
import zipfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

SCHEMA = "streamkit.features/1"
# npz columns have a fixed width; longer labels are cut.
LABEL_CHARACTERS = 64
COPY_BYTES = 1 << 20
ROWS_PER_GROUP = 4096

# Columns besides `vectors`, with their element types.
COLUMNS: dict[str, str] = {
    "seq": "<i8", "epoch": "<i8", "pts_ns": "<i8", "version": "<i8", "id": "<i8",
    "x": "<f8", "y": "<f8", "length": "<f8", "width": "<f8", "angle": "<f8",
    "flat": "|b1", "clipped": "<f8", "error": "<f4", "label": f"<U{LABEL_CHARACTERS}",
}  # fmt: skip


class VectorLengthChanged(ValueError):
    """The length of the vectors differs from that of earlier rows."""


@dataclass(frozen=True, eq=False)
class FeatureRows:
    """The feature vectors of a frame.

    Attributes:
        vectors: float32[n, k].
        columns: n values for each name of `COLUMNS`.
    """

    vectors: NDArray[np.float32]
    columns: dict[str, NDArray[Any]]


class FeatureWriter:
    """Base of the writers.

    Args:
        path: the file; an existing one is replaced by `finish`.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._temporary = path.with_name(f"{path.name}.{os.getpid()}.partial")
        self._length: int | None = None

    def write(self, rows: FeatureRows) -> None:
        """Appends the rows of a frame.

        Raises:
            VectorLengthChanged: their vectors have another length than those before.
            OSError: they cannot be written.
        """
        length = rows.vectors.shape[1]
        if self._length not in (None, length):
            raise VectorLengthChanged(
                f"vectors of one file must have one length, got {length} values after {self._length}; "
                "write a file for each feature space"
            )
        self._length = length
        self._append(rows)

    def finish(self) -> None:
        """Completes the file; raises OSError where it cannot be written."""
        raise NotImplementedError

    def discard(self) -> None:
        """Removes temporary files; has no effect after `finish`."""
        raise NotImplementedError

    def _append(self, rows: FeatureRows) -> None:
        raise NotImplementedError


class NpzFeatureWriter(FeatureWriter):
    """Writes `vectors` and the columns as members of an npz file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._types: dict[str, str] = {"vectors": "<f4", **COLUMNS}
        self._columns: dict[str, BinaryIO] = {}
        for name in self._types:
            column = tempfile.TemporaryFile(dir=path.absolute().parent)  # noqa: SIM115  closed by `discard`
            self._columns[name] = cast("BinaryIO", column)
        self._rows = 0

    @override
    def _append(self, rows: FeatureRows) -> None:
        for name, kind in self._types.items():
            values = rows.vectors if name == "vectors" else rows.columns[name]
            self._columns[name].write(np.ascontiguousarray(values, np.dtype(kind)).tobytes())
        self._rows += len(rows.vectors)

    @override
    def finish(self) -> None:
        schema = BytesIO()
        np.lib.format.write_array(schema, np.array(SCHEMA), allow_pickle=False)
        try:
            with zipfile.ZipFile(self._temporary, "w") as archive:
                archive.writestr("schema.npy", schema.getvalue())
                for name, kind in self._types.items():
                    shape = (self._rows, self._length or 0) if name == "vectors" else (self._rows,)
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                        fields = {"descr": kind, "fortran_order": False, "shape": shape}
                        np.lib.format.write_array_header_2_0(cast("BinaryIO", member), fields)
                        column = self._columns[name]
                        column.seek(0)
                        while chunk := column.read(COPY_BYTES):
                            member.write(chunk)
            self._temporary.replace(self._path)
        finally:
            self._temporary.unlink(missing_ok=True)
            self.discard()

    @override
    def discard(self) -> None:
        for column in self._columns.values():
            column.close()
