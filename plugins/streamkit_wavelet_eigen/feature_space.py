"""An immutable snapshot of a learnt eigenspace that embeds windows, and its file."""

import os
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.eigenspace import Eigenspace
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing, Threshold, prepare
from streamkit_wavelet_eigen.wavelet import FloatBatch

SCHEMA = "streamkit.eigenspace/1"
# A space of 64 components of 128x128 patches has 9 MB; the limit keeps a hostile file from filling memory.
FILE_LIMIT_BYTES = 64 * 1024 * 1024
# What zipfile and NumPy raise on a file that is no npz, is cut short, encrypted or lies about its sizes.
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, MemoryError)
# Grey levels; a window flatter than this shows noise, not a target.
FLAT_DEVIATION = 4.0


class InvalidSpaceFile(ValueError):
    """A file is not an eigenspace that this version can read."""


@dataclass(frozen=True, eq=False)
class WaveletEigenSpace:
    """Embeds windows by preparing them, making them vectors and projecting them.

    Vectors of different versions are coordinates on different axes: compare within one version, or embed the
    windows again.

    Attributes:
        space: mean and eigenvectors over height * width values.
        patch_size: (height, width) of the windows.
        components: length k of an embedded vector; columns past `space.rank` are 0.
        preprocessing: what is done to a window first.
        version: goes up by one with each update.
    """

    space: Eigenspace
    patch_size: tuple[int, int]
    components: int
    preprocessing: Preprocessing
    version: int

    def embed(self, patches: FloatBatch) -> FloatBatch:
        """Projects windows into the space.

        Args:
            patches: float32[n, h, w] in grey levels 0..255, (h, w) being `patch_size`.

        Returns:
            float32[n, components]; a flat window (deviation below 4 grey levels) has a row of zeros.

        Raises:
            ValueError: windows of another size, or one with NaN or infinity.
        """
        patches = checked_patches(patches, self.patch_size)
        flat = flat_windows(patches)
        return self.project(prepare(patches, self.preprocessing), flat)

    def project(self, prepared: FloatBatch, flat: NDArray[np.bool_]) -> FloatBatch:
        """Projects windows that are prepared already: float32[n, h, w] to float32[n, components]."""
        vectors = np.zeros((len(prepared), self.components), np.float32)
        basis, mean = self.space.basis.astype(np.float32), self.space.mean.astype(np.float32)
        vectors[:, : self.space.rank] = prepared.reshape(len(prepared), mean.size) @ basis.T - basis @ mean
        vectors[flat] = 0.0
        return vectors


def checked_patches(patches: FloatBatch, patch_size: tuple[int, int]) -> FloatBatch:
    """Returns the windows as float32[n, h, w] within 0..255.

    Raises:
        ValueError: they are not [n, h, w] of this size, or one is not finite.
    """
    patches = np.asarray(patches, dtype=np.float32)
    if patches.ndim != 3 or patches.shape[1:] != patch_size:
        height, width = patch_size
        raise ValueError(f"embed: patches must be float32[n, {height}, {width}], got shape {patches.shape}")
    finite = np.isfinite(patches).all(axis=(1, 2))
    if not finite.all():
        raise ValueError(
            f"embed: patches must be finite, patch {int(finite.argmin())} has NaN or infinity; leave it out"
        )
    return np.clip(patches, 0.0, 255.0)


def flat_windows(patches: FloatBatch) -> NDArray[np.bool_]:
    """bool[n]: which windows float32[n, h, w] show no structure."""
    result: NDArray[np.bool_] = patches.std(axis=(1, 2)) < FLAT_DEVIATION
    return result


def save_space(space: WaveletEigenSpace, path: Path) -> None:
    """Writes a space as an npz file with a schema field; an existing file is replaced whole or not at all.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        with temporary.open("wb") as file:
            np.savez_compressed(
                file,
                schema=np.array(SCHEMA),
                mean=space.space.mean,
                basis=space.space.basis,
                singular_values=space.space.singular_values,
                count=np.array(space.space.count),
                patch_size=np.array(space.patch_size),
                components=np.array(space.components),
                version=np.array(space.version),
                mode=np.array(str(space.preprocessing.mode)),
                threshold=np.array(str(space.preprocessing.threshold)),
                wavelet=np.array(space.preprocessing.wavelet),
            )
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def load_space(path: Path) -> WaveletEigenSpace:
    """Reads a file of `save_space`; nothing in it is executed.

    Raises:
        InvalidSpaceFile: it is no such file, is damaged, too large, or of another schema.
        OSError: it cannot be opened.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > FILE_LIMIT_BYTES:
            raise InvalidSpaceFile(
                f"{path}: an eigenspace file has at most {FILE_LIMIT_BYTES} bytes, got {size}"
            )
        with np.load(path, allow_pickle=False) as file:
            fields = {name: file[name] for name in file.files}
    except UNREADABLE as error:
        if isinstance(error, InvalidSpaceFile):
            raise
        raise InvalidSpaceFile(f"{path}: not an eigenspace file (npz): {error}") from error
    schema = str(fields.get("schema", "none"))
    if schema != SCHEMA:
        raise InvalidSpaceFile(
            f'{path}: the schema must be "{SCHEMA}", got "{schema}"; learn and save it again'
        )
    try:
        space = _space_of(fields)
        space.preprocessing.check(space.patch_size)
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise InvalidSpaceFile(f"{path}: damaged eigenspace file: {error}") from error
    return space


def _space_of(fields: dict[str, NDArray[Any]]) -> WaveletEigenSpace:
    height, width = (int(side) for side in fields["patch_size"])
    components = int(fields["components"])
    values = Eigenspace(
        np.array(fields["mean"], np.float64),
        np.array(fields["basis"], np.float64),
        np.array(fields["singular_values"], np.float64),
        float(fields["count"]),
    )
    rank, length = values.rank, height * width
    if min(height, width) < 1 or values.mean.shape != (length,) or values.basis.shape != (rank, length):
        raise ValueError(
            f"mean {values.mean.shape} and basis {values.basis.shape} do not fit {height}x{width} patches "
            f"and {rank} singular values"
        )
    if values.singular_values.ndim != 1 or not rank <= components <= length:
        raise ValueError(f"{rank} singular values do not fit {components} components of {length} values")
    numbers = (values.mean, values.basis, values.singular_values, np.array(values.count))
    if not all(np.isfinite(array).all() for array in numbers) or values.count <= 0:
        raise ValueError("values must be finite and the count positive")
    preprocessing = Preprocessing(
        Mode(str(fields["mode"])), Threshold(str(fields["threshold"])), str(fields["wavelet"])
    )
    return WaveletEigenSpace(values, (height, width), components, preprocessing, int(fields["version"]))
