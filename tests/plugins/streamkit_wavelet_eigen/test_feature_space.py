"""The snapshot embeds windows and survives its file; damaged files are refused."""

import io
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.eigenspace import learn_eigenspace
from streamkit_wavelet_eigen.feature_space import (
    FILE_LIMIT_BYTES,
    InvalidSpaceFile,
    WaveletEigenSpace,
    load_space,
    save_space,
)
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing, prepare


def _windows(count: int, side: int = 16, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, side, side)).astype(np.float32)


def _learnt(mode: Mode = Mode.RAW, components: int = 4, count: int = 12) -> WaveletEigenSpace:
    how = Preprocessing(mode)
    vectors = prepare(_windows(count), how).reshape(count, -1).astype(np.float64)
    return WaveletEigenSpace(learn_eigenspace(vectors, components), (16, 16), components, how, 3)


@pytest.mark.parametrize("mode", list(Mode))
def test_embedding_is_the_projection_of_the_prepared_window(mode: Mode) -> None:
    """`embed` prepares, makes vectors and projects: float32[n, components]."""
    space, given = _learnt(mode), _windows(5, seed=8)
    prepared = prepare(given, space.preprocessing).reshape(5, -1).astype(np.float64)
    embedded = space.embed(given)
    assert embedded.dtype == np.float32
    np.testing.assert_allclose(embedded, space.space.project(prepared), atol=0.05)


def test_missing_directions_are_zero_columns() -> None:
    """The length of a vector is fixed: columns past the rank are zero."""
    space = _learnt(components=8, count=3)
    embedded = space.embed(_windows(4, seed=2))
    assert embedded.shape == (4, 8)
    assert (embedded[:, 2:] == 0).all()
    assert np.abs(embedded[:, :2]).min() > 0


def test_flat_windows_have_zero_rows() -> None:
    """A window without structure says nothing about a target: zeros, not equalised noise."""
    given = _windows(3)
    given[1] = 77.0
    embedded = _learnt(Mode.PAPER).embed(given)
    assert (embedded[1] == 0).all()
    assert np.abs(embedded[[0, 2]]).max() > 0


def test_no_window_gives_no_row() -> None:
    """An empty batch has an empty embedding."""
    assert _learnt().embed(np.zeros((0, 16, 16), np.float32)).shape == (0, 4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_windows_that_are_not_finite_are_refused(value: float) -> None:
    """NaN and infinity are refused with the number of the window."""
    given = _windows(3)
    given[2, 0, 0] = value
    with pytest.raises(ValueError, match="patch 2 has NaN or infinity"):
        _learnt().embed(given)


@pytest.mark.parametrize("shape", [(2, 8, 8), (16, 16), (2, 16, 16, 1)])
def test_windows_of_another_size_are_refused(shape: tuple[int, ...]) -> None:
    """The error names the size asked for and the shape it got."""
    with pytest.raises(ValueError, match=r"float32\[n, 16, 16\], got shape"):
        _learnt().embed(np.zeros(shape, np.float32))


def test_file_round_trip(tmp_path: Path) -> None:
    """A saved space embeds as before, and keeps version and settings."""
    space, path = _learnt(Mode.DENOISE), tmp_path / "space.npz"
    save_space(space, path)
    read = load_space(path)
    assert (read.version, read.patch_size, read.components, read.preprocessing) == (
        space.version,
        space.patch_size,
        space.components,
        space.preprocessing,
    )
    np.testing.assert_array_equal(read.embed(_windows(4, seed=6)), space.embed(_windows(4, seed=6)))
    assert [entry.name for entry in tmp_path.iterdir()] == ["space.npz"]


def test_a_failed_save_leaves_no_file_behind(tmp_path: Path) -> None:
    """A folder that is not there is an OSError, and nothing half written stays."""
    with pytest.raises(OSError, match="No such file"):
        save_space(_learnt(), tmp_path / "missing" / "space.npz")
    assert list(tmp_path.iterdir()) == []


def _rewritten(path: Path, **changes: np.ndarray | None) -> Path:
    save_space(_learnt(), path)
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
        {"schema": np.array("streamkit.eigenspace/99")},
        {"schema": None},
        {"mean": np.zeros(3)},
        {"mean": None},
        {"mean": np.full(256, np.nan)},
        {"basis": np.zeros((4, 9))},
        {"singular_values": np.array(1.0)},
        {"count": np.array(0.0)},
        {"count": np.array(np.inf)},
        {"patch_size": np.array([16])},
        {"patch_size": np.array([-16, -16])},
        {"components": np.array(10**9)},
        {"components": np.array("many")},
        {"mode": np.array("magic")},
        {"wavelet": np.array("bior2.2"), "mode": np.array("paper")},
    ],
    ids=" ".join,
)
def test_damaged_fields_are_refused(tmp_path: Path, changes: dict[str, np.ndarray | None]) -> None:
    """A field that is missing, of another shape or not finite is refused with the file's name."""
    path = _rewritten(tmp_path / "space.npz", **changes)
    with pytest.raises(InvalidSpaceFile, match=r"space\.npz"):
        load_space(path)


def test_pickles_are_never_read(tmp_path: Path) -> None:
    """An array of objects would execute code on reading: refused."""
    path = _rewritten(tmp_path / "space.npz", mean=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InvalidSpaceFile, match="allow_pickle"):
        load_space(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 short", b"no archive at all" * 9])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    """What is no npz is refused as such."""
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidSpaceFile, match="not an eigenspace file"):
        load_space(path)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    """A file cut anywhere is refused, never half read."""
    path = tmp_path / "space.npz"
    save_space(_learnt(), path)
    content = path.read_bytes()
    for length in range(0, len(content), 97):
        path.write_bytes(content[:length])
        with pytest.raises(InvalidSpaceFile):
            load_space(path)


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
    with pytest.raises(InvalidSpaceFile, match="at most"):
        load_space(path)


@pytest.mark.parametrize(("mode", "least"), [(Mode.RAW, 0.88), (Mode.PAPER, 0.85)])
def test_faces_are_recognised(streamkit_data: Path, mode: Mode, least: float) -> None:
    """ORL, 5 training pictures, 40 components, nearest neighbour: near the published 93 and 91 %."""
    pictures = np.stack(
        [
            cv2.resize(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), (64, 64), interpolation=cv2.INTER_AREA)
            for person in range(1, 41)
            for path in (streamkit_data / "orl" / f"s{person}" / f"{view}.pgm" for view in range(1, 11))
        ]
    ).astype(np.float32)
    order = np.random.default_rng(1000).permuted(np.tile(np.arange(10), (40, 1)), axis=1)
    chosen = (order[:, :5] + 10 * np.arange(40)[:, None]).ravel()
    training = np.zeros(400, bool)
    training[chosen] = True
    how = Preprocessing(mode)
    vectors = prepare(pictures[training], how).reshape(200, -1).astype(np.float64)
    space = WaveletEigenSpace(learn_eigenspace(vectors, 40), (64, 64), 40, how, 1)
    gallery, probes = space.embed(pictures[training]), space.embed(pictures[~training])
    nearest = ((probes[:, None] - gallery[None]) ** 2).sum(axis=2).argmin(axis=1)
    labels = np.repeat(np.arange(40), 10)
    assert (labels[training][nearest] == labels[~training]).mean() >= least
