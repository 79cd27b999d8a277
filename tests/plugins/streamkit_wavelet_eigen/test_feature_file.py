"""Files of vectors: complete or absent, columns with vectors, bounded memory, npz and parquet alike."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from streamkit_wavelet_eigen.feature_file import (
    COLUMNS,
    LABEL_CHARACTERS,
    SCHEMA,
    FeatureRows,
    FeatureWriter,
    NpzFeatureWriter,
    VectorLengthChanged,
)
from streamkit_wavelet_eigen.parquet_file import ROWS_PER_GROUP, ParquetFeatureWriter

Make = Callable[[Path], FeatureWriter]
WRITERS = pytest.mark.parametrize(
    ("make", "end"), [(NpzFeatureWriter, "npz"), (ParquetFeatureWriter, "parquet")], ids=["npz", "parquet"]
)


def _rows(count: int, seed: int = 0, length: int = 3) -> FeatureRows:
    generator = np.random.default_rng(seed)
    columns: dict[str, np.ndarray] = {
        name: generator.integers(0, 2, count).astype(np.dtype(kind)) for name, kind in COLUMNS.items()
    }
    columns["label"] = np.array([f"target {number}" for number in range(count)], dtype=np.str_)
    columns["seq"] = np.full(count, seed)
    return FeatureRows(generator.normal(size=(count, length)).astype(np.float32), columns)


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    table = pyarrow.parquet.read_table(path)
    assert table.schema.metadata[b"schema"] == SCHEMA.encode()
    read = {name: np.array(table[name].to_pylist()) for name in table.column_names}
    return {"vectors": read.pop("vector"), "schema": np.array(SCHEMA), **read}


@WRITERS
def test_what_is_written_is_read(tmp_path: Path, make: Make, end: str) -> None:
    """Rows of several frames are concatenated in every column."""
    path = tmp_path / f"features.{end}"
    writer = make(path)
    parts = [_rows(4, 1), _rows(0, 2), _rows(3, 3)]
    for part in parts:
        writer.write(part)
    assert not path.exists()
    writer.finish()
    read = _read(path)
    assert str(read["schema"]) == SCHEMA
    np.testing.assert_array_equal(read["vectors"], np.concatenate([part.vectors for part in parts]))
    for name in COLUMNS:
        expected = np.concatenate([part.columns[name] for part in parts if len(part.vectors)])
        np.testing.assert_array_equal(read[name], expected)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@WRITERS
def test_no_row_is_an_empty_file(tmp_path: Path, make: Make, end: str) -> None:
    """A stream without targets leaves a file that can be read, with no row."""
    path = tmp_path / f"features.{end}"
    make(path).finish()
    read = _read(path)
    assert len(read["vectors"]) == len(read["seq"]) == 0


@WRITERS
def test_another_length_is_refused(tmp_path: Path, make: Make, end: str) -> None:
    """Vectors of two spaces do not fit one table; the error names both lengths."""
    writer = make(tmp_path / f"features.{end}")
    writer.write(_rows(2, length=3))
    with pytest.raises(VectorLengthChanged, match="got 5 values after 3"):
        writer.write(_rows(2, length=5))
    writer.finish()


@WRITERS
def test_discarded_rows_leave_nothing(tmp_path: Path, make: Make, end: str) -> None:
    """Without `save` neither the file nor a part of it stays."""
    writer = make(tmp_path / f"features.{end}")
    writer.write(_rows(ROWS_PER_GROUP + 1))
    writer.close()
    assert list(tmp_path.iterdir()) == []


@WRITERS
def test_an_older_file_is_replaced_at_the_end(tmp_path: Path, make: Make, end: str) -> None:
    """Until the new one is saved the old one stays; each save has all rows."""
    path = tmp_path / f"features.{end}"
    path.write_bytes(b"old")
    writer = make(path)
    writer.write(_rows(2))
    assert path.read_bytes() == b"old"
    for count in (2, 4):
        writer.save()
        assert len(_read(path)["vectors"]) == count
        writer.write(_rows(2))
    writer.close()


def test_parquet_comes_in_groups(tmp_path: Path) -> None:
    """Rows are written out while the stream runs, not kept until its end."""
    path = tmp_path / "features.parquet"
    writer = ParquetFeatureWriter(path)
    for seed in range(3):
        writer.write(_rows(ROWS_PER_GROUP, seed))
    writer.finish()
    assert pyarrow.parquet.ParquetFile(path).num_row_groups == 3


def test_npz_cuts_long_labels(tmp_path: Path) -> None:
    """One column has one width."""
    rows = _rows(1)
    rows.columns["label"] = np.array(["x" * 500])
    writer = NpzFeatureWriter(tmp_path / "features.npz")
    writer.write(rows)
    writer.finish()
    assert _read(tmp_path / "features.npz")["label"].tolist() == ["x" * LABEL_CHARACTERS]
