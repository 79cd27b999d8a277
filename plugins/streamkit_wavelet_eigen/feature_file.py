"""Files of feature vectors: rows gathered as they come, in memory that does not grow with the stream.

npz needs the number of rows before the first, so columns wait in temporary files beside the target; parquet
is written group by group. A file is there whole or not at all.
"""

import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

SCHEMA = "streamkit.features/1"
# Words are cut to this: npz columns have one width.
LABEL_CHARACTERS = 64
COPY_BYTES = 1 << 20
ROWS_PER_GROUP = 4096

# Columns beside `vectors`, with their element types.
COLUMNS: dict[str, str] = {
    "seq": "<i8",
    "epoch": "<i8",
    "pts_ns": "<i8",
    "version": "<i8",
    "id": "<i8",
    "x": "<f8",
    "y": "<f8",
    "length": "<f8",
    "width": "<f8",
    "angle": "<f8",
    "flat": "|b1",
    "clipped": "<f8",
    "error": "<f4",
    "label": f"<U{LABEL_CHARACTERS}",
}


class VectorLengthChanged(ValueError):
    """Vectors of another length than the file began with."""


@dataclass(frozen=True, eq=False)
class FeatureRows:
    """The vectors of one frame with what belongs to them.

    Attributes:
        vectors: float32[n, k].
        columns: n values for each name of `COLUMNS`.
    """

    vectors: NDArray[np.float32]
    columns: dict[str, NDArray[Any]]


class FeatureWriter(Protocol):
    """Takes rows, and makes a file of them."""

    def write(self, rows: FeatureRows) -> None:
        """Takes the rows of one frame; raises VectorLengthChanged or OSError."""

    def finish(self) -> None:
        """Makes the file."""

    def discard(self) -> None:
        """Leaves nothing behind; does nothing after `finish`."""


class NpzFeatureWriter:
    """Writes `vectors` and the columns as members of one npz file.

    Args:
        path: the file; one that is there is replaced by `finish`.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._types: dict[str, str] = {"vectors": "<f4", **COLUMNS}
        self._parts: dict[str, BinaryIO] = {}
        for name in self._types:
            part = tempfile.TemporaryFile(dir=path.absolute().parent)  # noqa: SIM115  closed by `discard`
            self._parts[name] = cast("BinaryIO", part)
        self._rows, self._length = 0, 0
        self._begun = False

    def write(self, rows: FeatureRows) -> None:
        """Adds the rows of one frame.

        Raises:
            VectorLengthChanged: they are longer or shorter than those before.
            OSError: there is no room.
        """
        count, length = rows.vectors.shape
        if self._begun and length != self._length:
            raise VectorLengthChanged(length_text(self._length, length))
        self._begun, self._length = True, length
        for name, kind in self._types.items():
            values = rows.vectors if name == "vectors" else rows.columns[name]
            self._parts[name].write(np.ascontiguousarray(values, np.dtype(kind)).tobytes())
        self._rows += count

    def finish(self) -> None:
        """Joins the columns into the file.

        Raises:
            OSError: it cannot be written.
        """
        temporary = partial_path(self._path)
        try:
            with zipfile.ZipFile(temporary, "w") as archive:
                archive.writestr("schema.npy", _whole(np.array(SCHEMA)))
                for name, kind in self._types.items():
                    shape = (self._rows, self._length) if name == "vectors" else (self._rows,)
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                        fields = {"descr": kind, "fortran_order": False, "shape": shape}
                        np.lib.format.write_array_header_2_0(cast("BinaryIO", member), fields)
                        part = self._parts[name]
                        part.seek(0)
                        while chunk := part.read(COPY_BYTES):
                            member.write(chunk)
            temporary.replace(self._path)
        finally:
            temporary.unlink(missing_ok=True)
            self.discard()

    def discard(self) -> None:
        """Closes the temporary files, which removes them."""
        for part in self._parts.values():
            part.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()


def _whole(array: NDArray[Any]) -> bytes:
    from io import BytesIO

    memory = BytesIO()
    np.lib.format.write_array(memory, array, allow_pickle=False)
    return memory.getvalue()


def partial_path(path: Path) -> Path:
    """Where a file is made before it takes its place."""
    return path.with_name(f"{path.name}.{os.getpid()}.partial")


def length_text(before: int, now: int) -> str:
    """The rule that vectors of one file have one length."""
    return (
        f"vectors of one file must have one length, got {now} values after {before}; "
        "write a file for each feature space"
    )
