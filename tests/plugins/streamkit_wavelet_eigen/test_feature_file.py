"""Files of vectors: complete or absent, columns with vectors, bounded memory, npz and parquet alike."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from streamkit import StreamError
from streamkit_wavelet_eigen.featuresink import (
    COLUMNS,
    LABEL_CHARACTERS,
    ROWS_PER_GROUP,
    SCHEMA,
    FeatureWriter,
    Rows,
    empty_rows,
)

FORMATS = pytest.mark.parametrize("suffix", ["npz", "parquet"])


def _rows(count: int, seed: int = 0, length: int = 3) -> Rows:
    generator = np.random.default_rng(seed)
    rows = empty_rows(count, length)
    for name in COLUMNS:
        rows[name] = generator.integers(0, 2, count)
    rows["label"] = [f"target {number}" for number in range(count)]
    rows["seq"] = seed
    rows["vectors"] = generator.normal(size=(count, length))
    return rows


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    table = pyarrow.parquet.read_table(path)
    assert table.schema.metadata[b"schema"] == SCHEMA.encode()
    read = {name: np.array(table[name].to_pylist()) for name in table.column_names}
    return {"vectors": read.pop("vector"), "schema": np.array(SCHEMA), **read}


@FORMATS
def test_what_is_written_is_read(tmp_path: Path, suffix: str) -> None:
    """Rows of several frames are concatenated in every column."""
    path = tmp_path / f"features.{suffix}"
    writer = FeatureWriter(path)
    parts = [_rows(4, 1), _rows(0, 2), _rows(3, 3)]
    for part in parts:
        writer.write(part)
    assert not path.exists()
    writer.finish()
    read = _read(path)
    assert str(read["schema"]) == SCHEMA
    np.testing.assert_array_equal(read["vectors"], np.concatenate([part["vectors"] for part in parts]))
    for name in COLUMNS:
        np.testing.assert_array_equal(read[name], np.concatenate([part[name] for part in parts]))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@FORMATS
def test_no_row_is_an_empty_file(tmp_path: Path, suffix: str) -> None:
    """A stream without targets leaves a file that can be read, with no row."""
    path = tmp_path / f"features.{suffix}"
    FeatureWriter(path).finish()
    read = _read(path)
    assert len(read["vectors"]) == len(read["seq"]) == 0


@FORMATS
def test_another_length_is_refused(tmp_path: Path, suffix: str) -> None:
    """Vectors of two spaces do not fit one table; the error names both lengths."""
    writer = FeatureWriter(tmp_path / f"features.{suffix}")
    writer.write(_rows(2, length=3))
    with pytest.raises(StreamError, match="got 5 values after 3"):
        writer.write(_rows(2, length=5))
    writer.finish()


@FORMATS
def test_discarded_rows_leave_nothing(tmp_path: Path, suffix: str) -> None:
    """Without `save` neither the file nor a part of it stays."""
    writer = FeatureWriter(tmp_path / f"features.{suffix}")
    writer.write(_rows(ROWS_PER_GROUP + 1))
    writer.close()
    assert list(tmp_path.iterdir()) == []


@FORMATS
def test_an_older_file_is_replaced_at_the_end(tmp_path: Path, suffix: str) -> None:
    """Until the new one is saved the old one stays; each save has all rows."""
    path = tmp_path / f"features.{suffix}"
    path.write_bytes(b"old")
    writer = FeatureWriter(path)
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
    writer = FeatureWriter(path)
    for seed in range(3):
        writer.write(_rows(ROWS_PER_GROUP, seed))
    writer.finish()
    assert pyarrow.parquet.ParquetFile(path).num_row_groups == 3


def test_npz_cuts_long_labels(tmp_path: Path) -> None:
    """One column has one width."""
    rows = _rows(1)
    rows["label"] = ["x" * 500]
    writer = FeatureWriter(tmp_path / "features.npz")
    writer.write(rows)
    writer.finish()
    assert _read(tmp_path / "features.npz")["label"].tolist() == ["x" * LABEL_CHARACTERS]
