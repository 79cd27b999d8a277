"""A model survives its file; damaged and hostile files are refused."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from streamkit_wavelet_eigen.feature_space import learn_space
from streamkit_wavelet_eigen.gallery import Gallery
from streamkit_wavelet_eigen.model_file import (
    FILE_LIMIT_BYTES,
    InvalidModelFile,
    Model,
    load_model,
    save_model,
)
from streamkit_wavelet_eigen.recipe import Basis, Metric, Mode, Preprocessing, Recipe, Threshold, Views

WHOLE = Recipe(16, Preprocessing(Mode.RAW), components=4)
RECIPES = [
    WHOLE,
    Recipe(16, Preprocessing(Mode.PAPER, Threshold.BAYES), blocks=4, components=3, metric=Metric.SUMMED),
    Recipe(16, Preprocessing(Mode.DENOISE, wavelet="haar"), 2, Basis.PER_BLOCK, 5, 0.9),
    Recipe(
        16, Preprocessing(Mode.RAW, approximation=1), components=6, discriminative=True, shrinkage=0.2,
        views=Views.SHIFTED, metric=Metric.COSINE,
    ),
]  # fmt: skip


def _windows(count: int, side: int = 16, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, side, side)).astype(np.float32)


def _learnt(recipe: Recipe = WHOLE) -> Model:
    windows, labels = _windows(12), tuple(f"target {number % 3}" for number in range(12))
    return Model(learn_space(windows, recipe, labels), Gallery(windows.astype(np.uint8), labels))


@pytest.mark.parametrize("recipe", RECIPES, ids=["whole", "shared", "per-block", "fisher"])
def test_file_round_trip(tmp_path: Path, recipe: Recipe) -> None:
    """A saved model embeds as before, and keeps version, settings and gallery."""
    model, path = _learnt(recipe), tmp_path / "space.npz"
    save_model(model, path)
    read = load_model(path)
    assert (read.space.version, read.space.recipe) == (model.space.version, recipe)
    assert read.gallery.labels == model.gallery.labels
    np.testing.assert_array_equal(read.gallery.patches, model.gallery.patches)
    given = _windows(4, seed=6)
    np.testing.assert_array_equal(read.space.embed(given), model.space.embed(given))
    assert [entry.name for entry in tmp_path.iterdir()] == ["space.npz"]


def test_a_failed_save_leaves_no_file_behind(tmp_path: Path) -> None:
    """The name of a folder is an OSError, and nothing half written stays."""
    (tmp_path / "space.npz").mkdir()
    with pytest.raises(IsADirectoryError):
        save_model(_learnt(), tmp_path / "space.npz")
    assert [entry.name for entry in tmp_path.rglob("*")] == ["space.npz"]


def _rewritten(path: Path, **changes: np.ndarray | None) -> Path:
    save_model(_learnt(), path)
    with np.load(path) as file:
        fields = {name: file[name] for name in file.files}
    fields.update({name: value for name, value in changes.items() if value is not None})
    for name in [name for name, value in changes.items() if value is None]:
        del fields[name]
    np.savez(path, **fields)
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"schema": np.array("streamkit.eigenspace/1")},
        {"schema": None},
        {"mean": np.zeros(3)},
        {"mean": None},
        {"mean": np.full((1, 256), np.nan)},
        {"basis": np.zeros((4, 9))},
        {"singular_values": np.array(1.0)},
        {"counts": np.array([0.0])},
        {"counts": np.array([np.inf])},
        {"ranks": np.array([-1])},
        {"ranks": np.array([5, 4])},
        {"patch": np.array(-16)},
        {"patch": np.array([16, 16])},
        {"patch": np.array(10**9)},
        {"components": np.array(10**9)},
        {"components": np.array("many")},
        {"blocks": np.array(0)},
        {"energy": np.array(np.nan)},
        {"mode": np.array("magic")},
        {"wavelet": np.array("morl"), "mode": np.array("paper")},
        {"discriminative": np.array(True)},
        {"gallery": np.zeros((2, 8, 8), np.uint8)},
        {"gallery": np.zeros((12, 16, 16))},
        {"labels": np.array(["one"])},
    ],
    ids=" ".join,
)
def test_damaged_fields_are_refused(tmp_path: Path, changes: dict[str, np.ndarray | None]) -> None:
    """A field that is missing, of another shape or not finite is refused with the file's name."""
    path = _rewritten(tmp_path / "space.npz", **changes)
    with pytest.raises(InvalidModelFile, match=r"space\.npz"):
        load_model(path)


def test_pickles_are_never_read(tmp_path: Path) -> None:
    """An array of objects would execute code on reading: refused."""
    path = _rewritten(tmp_path / "space.npz", mean=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InvalidModelFile, match="allow_pickle"):
        load_model(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 short", b"no archive at all" * 9])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    """What is no npz is refused as such."""
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidModelFile, match="not an eigenspace file"):
        load_model(path)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    """A file cut anywhere is refused, never half read."""
    path = tmp_path / "space.npz"
    save_model(_learnt(), path)
    content = path.read_bytes()
    for length in range(0, len(content), 97):
        path.write_bytes(content[:length])
        with pytest.raises(InvalidModelFile):
            load_model(path)


def test_huge_files_are_refused_unread(tmp_path: Path) -> None:
    """An archive that unpacks to more than the limit is refused before it is unpacked."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (FILE_LIMIT_BYTES // 8,)}
    )
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mean.npy", header.getvalue() + bytes(FILE_LIMIT_BYTES))
    assert path.stat().st_size < FILE_LIMIT_BYTES // 100
    with pytest.raises(InvalidModelFile, match="at most"):
        load_model(path)
