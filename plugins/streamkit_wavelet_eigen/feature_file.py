"""Files of feature vectors, npz or parquet, in memory that does not grow with the stream.

Columns are collected in temporary files, of which a whole file is made each time it is saved.
"""

import tempfile
import zipfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit.output.file import OutputFile

SCHEMA = "streamkit.features/1"
# npz columns have a fixed width; longer labels are cut.
LABEL_CHARACTERS = 64
COPY_BYTES = 1 << 20

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
    """Collects rows; base of the formats, which override `write_file`.

    Args:
        path: the file; its folder is made, an existing file is replaced by `save`.

    Attributes:
        rows: number of rows.
        length: of the vectors.
        types: element types by column.

    Raises:
        OSError: the folder takes no files.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rows = self.length = 0
        self.types: dict[str, str] = {"vectors": "<f4", **COLUMNS}
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
        self._columns: dict[str, BinaryIO] = {}
        for name in self.types:
            column = tempfile.TemporaryFile(dir=path.absolute().parent)  # noqa: SIM115  closed by `close`
            self._columns[name] = cast("BinaryIO", column)

    def write(self, rows: FeatureRows) -> None:
        """Appends the rows of a frame.

        Raises:
            VectorLengthChanged: their vectors have another length than those before.
            OSError: they cannot be written.
        """
        length = rows.vectors.shape[1]
        if self.rows and self.length != length:
            raise VectorLengthChanged(
                f"vectors of one file must have one length, got {length} values after {self.length}; "
                "write a file for each feature space"
            )
        self.length = length
        for name, kind in self.types.items():
            values = rows.vectors if name == "vectors" else rows.columns[name]
            self._columns[name].write(np.ascontiguousarray(values, np.dtype(kind)).tobytes())
        self.rows += len(rows.vectors)

    def save(self) -> None:
        """Makes the file of all rows so far; raises OSError where it cannot be written."""
        file = OutputFile(self._path, is_whole=True)
        try:
            self.write_file(file)
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
        """Removes the temporary files."""
        for column in self._columns.values():
            column.close()

    def write_file(self, file: OutputFile) -> None:
        """Writes all rows to an empty file."""
        raise NotImplementedError

    def column(self, name: str) -> BinaryIO:
        """The bytes of a column so far; leave it at its end."""
        self._columns[name].seek(0)
        return self._columns[name]


class NpzFeatureWriter(FeatureWriter):
    """Writes `vectors` and the columns as members of an npz file."""

    @override
    def write_file(self, file: OutputFile) -> None:
        schema = BytesIO()
        np.lib.format.write_array(schema, np.array(SCHEMA), allow_pickle=False)
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("schema.npy", schema.getvalue())
            for name, kind in self.types.items():
                shape = (self.rows, self.length) if name == "vectors" else (self.rows,)
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    fields = {"descr": kind, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_2_0(cast("BinaryIO", member), fields)
                    column = self.column(name)
                    while chunk := column.read(COPY_BYTES):
                        member.write(chunk)
