"""The file of a feature space and its gallery: npz with a schema, never a pickle."""

import dataclasses
import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from streamkit.output.file import write_whole
from streamkit_wavelet_eigen.eigenspace import Eigenspace
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace
from streamkit_wavelet_eigen.gallery import Gallery, empty_gallery
from streamkit_wavelet_eigen.recipe import Preprocessing, Recipe

Fields = dict[str, NDArray[Any]]

SCHEMA = "streamkit.eigenspace/2"
# Settings whose name stands for an array in the file.
FILE_NAMES = {"basis": "basis_of"}
# A gallery of 4096 windows of 64x64 has 16 MB, 64 components of 128x128 patches 9 MB; the limit keeps a
# hostile file from filling memory.
FILE_LIMIT_BYTES = 128 * 1024 * 1024
# Exceptions of zipfile and NumPy for a file that is no npz, truncated, encrypted or of wrong sizes.
UNREADABLE = (
    zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, MemoryError, NotImplementedError
)  # fmt: skip


class InvalidModelFile(ValueError):
    """The file is not an eigenspace that this version can read."""


@dataclass(frozen=True, eq=False)
class Model:
    """A learnt space and its gallery of labelled windows, which may be empty."""

    space: WaveletEigenSpace
    gallery: Gallery


def save_model(model: Model, path: Path) -> None:
    """Writes a model as an npz file, in place of an existing one when complete; folders are made.

    Raises:
        OSError: the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **_fields_of(model))
    write_whole(path, content.getvalue())


def load_model(path: Path) -> Model:
    """Reads a file of `save_model`; nothing in it is executed.

    Raises:
        InvalidModelFile: the file is no npz, damaged, too large, or of another schema.
        OSError: the file cannot be opened.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > FILE_LIMIT_BYTES:
            raise InvalidModelFile(
                f"{path}: an eigenspace file has at most {FILE_LIMIT_BYTES} bytes, got {size}"
            )
        with np.load(path, allow_pickle=False) as file:
            fields = {name: file[name] for name in file.files}
    except UNREADABLE as error:
        if isinstance(error, InvalidModelFile):
            raise
        raise InvalidModelFile(f"{path}: not an eigenspace file (npz): {error}") from error
    schema = str(fields.get("schema", "none"))
    if schema != SCHEMA:
        raise InvalidModelFile(
            f'{path}: the schema must be "{SCHEMA}", got "{schema}"; learn and save it again'
        )
    try:
        recipe = _read_recipe(fields)
        recipe.check()
        return Model(_read_space(fields, recipe), _read_gallery(fields, recipe))
    except (KeyError, ValueError, TypeError, OverflowError, IndexError) as error:
        raise InvalidModelFile(f"{path}: damaged eigenspace file: {error}") from error


def _fields_of(model: Model) -> Fields:
    space = model.space
    fields: Fields = {
        "schema": np.array(SCHEMA),
        "version": np.array(space.version),
        "mean": np.stack([part.mean for part in space.spaces]),
        "ranks": np.array([part.rank for part in space.spaces]),
        "basis": np.concatenate([part.basis for part in space.spaces]),
        "singular_values": np.concatenate([part.singular_values for part in space.spaces]),
        "counts": np.array([part.count for part in space.spaces]),
        "gallery": model.gallery.patches,
        "labels": np.array(model.gallery.labels, dtype=np.str_),
    }
    if space.fisher_axes is not None:
        fields["fisher_axes"] = space.fisher_axes
    settings = msgspec.to_builtins(space.recipe)
    settings |= settings.pop("preprocessing")
    return fields | {FILE_NAMES.get(name, name): np.array(value) for name, value in settings.items()}


def _read_recipe(fields: Fields) -> Recipe:
    names = [field.name for kind in (Recipe, Preprocessing) for field in dataclasses.fields(kind)]
    names.remove("preprocessing")
    settings = {name: fields[FILE_NAMES.get(name, name)].item() for name in names}
    return msgspec.convert(settings | {"preprocessing": settings}, Recipe)


def _read_space(fields: Fields, recipe: Recipe) -> WaveletEigenSpace:
    means, counts = np.array(fields["mean"], np.float64), np.array(fields["counts"], np.float64)
    basis, strengths = np.array(fields["basis"], np.float64), np.array(fields["singular_values"], np.float64)
    ranks = [int(rank) for rank in fields["ranks"]]
    total, values = sum(ranks), recipe.block_values
    if means.shape != (recipe.spaces, values) or len(ranks) != recipe.spaces or counts.shape != (len(ranks),):
        raise ValueError(f"means {means.shape} do not fit {recipe.spaces} spaces of {values} values")
    if basis.shape != (total, values) or strengths.shape != (total,):
        raise ValueError(f"basis {basis.shape} does not fit {total} vectors of {values} values")
    if not all(0 <= rank <= recipe.components for rank in ranks):
        raise ValueError(f"ranks {ranks} must be 0 to {recipe.components}")
    finite = all(np.isfinite(array).all() for array in (means, basis, strengths, counts))
    if not finite or (counts <= 0).any():
        raise ValueError("values must be finite and the counts positive")
    ends = np.cumsum(ranks)
    spaces = tuple(
        Eigenspace(
            means[index].copy(), basis[end - rank : end], strengths[end - rank : end], float(counts[index])
        )
        for index, (rank, end) in enumerate(zip(ranks, ends, strict=True))
    )
    return WaveletEigenSpace(spaces, recipe, int(fields["version"]), _read_fisher_axes(fields, recipe))


def _read_fisher_axes(fields: Fields, recipe: Recipe) -> NDArray[np.float64] | None:
    if not recipe.discriminative:
        return None
    axes = np.array(fields["fisher_axes"], np.float64)
    length = recipe.blocks**2 * recipe.components
    if axes.ndim != 2 or axes.shape[0] != length or not np.isfinite(axes).all():
        raise ValueError(f"Fisher axes {axes.shape} must be finite and have {length} rows")
    return axes


def _read_gallery(fields: Fields, recipe: Recipe) -> Gallery:
    patches, labels = fields["gallery"], tuple(str(label) for label in fields["labels"])
    if not labels:
        return empty_gallery(recipe.patch)
    if patches.dtype != np.uint8 or patches.shape != (len(labels), *recipe.patch_size):
        raise ValueError(f"gallery {patches.dtype} {patches.shape} does not fit {len(labels)} labels")
    return Gallery(patches, labels)
