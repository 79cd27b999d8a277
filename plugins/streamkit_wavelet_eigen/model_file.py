"""The file of a feature space and its gallery: npz with a schema, never a pickle."""

import os
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.eigenspace import Eigenspace
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace
from streamkit_wavelet_eigen.gallery import Gallery, empty_gallery
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing, Threshold
from streamkit_wavelet_eigen.recipe import Basis, Metric, Recipe, Views

SCHEMA = "streamkit.eigenspace/2"
# A gallery of 4096 windows of 64x64 has 16 MB, 64 components of 128x128 patches 9 MB; the limit keeps a
# hostile file from filling memory.
FILE_LIMIT_BYTES = 128 * 1024 * 1024
# What zipfile and NumPy raise on a file that is no npz, is cut short, encrypted or lies about its sizes.
UNREADABLE = (
    zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, MemoryError, NotImplementedError
)  # fmt: skip


class InvalidModelFile(ValueError):
    """A file is not an eigenspace that this version can read."""


@dataclass(frozen=True, eq=False)
class Model:
    """What a file holds.

    Attributes:
        space: the learnt space.
        gallery: labelled windows; may be empty.
    """

    space: WaveletEigenSpace
    gallery: Gallery


def save_model(model: Model, path: Path) -> None:
    """Writes a model as an npz file with a schema field; an existing file is replaced whole or not at all.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        with temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **_fields_of(model))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def load_model(path: Path) -> Model:
    """Reads a file of `save_model`; nothing in it is executed.

    Raises:
        InvalidModelFile: it is no such file, is damaged, too large, or of another schema.
        OSError: it cannot be opened.
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
        recipe = _recipe_of(fields)
        recipe.check()
        return Model(_space_of(fields, recipe), _gallery_of(fields, recipe))
    except (KeyError, ValueError, TypeError, OverflowError, IndexError) as error:
        raise InvalidModelFile(f"{path}: damaged eigenspace file: {error}") from error


def _fields_of(model: Model) -> dict[str, NDArray[Any]]:
    space, recipe = model.space, model.space.recipe
    fields: dict[str, NDArray[Any]] = {
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
    how = recipe.preprocessing
    settings: dict[str, int | float | bool | str] = {
        "patch": recipe.patch, "mode": str(how.mode), "threshold": str(how.threshold),
        "wavelet": how.wavelet, "approximation": how.approximation, "blocks": recipe.blocks,
        "basis_of": str(recipe.basis), "components": recipe.components, "energy": recipe.energy,
        "discriminative": recipe.discriminative, "shrinkage": recipe.shrinkage,
        "views": str(recipe.views), "metric": str(recipe.metric),
    }  # fmt: skip
    return fields | {name: np.array(value) for name, value in settings.items()}


def _recipe_of(fields: dict[str, NDArray[Any]]) -> Recipe:
    preprocessing = Preprocessing(
        Mode(str(fields["mode"])),
        Threshold(str(fields["threshold"])),
        str(fields["wavelet"]),
        int(fields["approximation"]),
    )
    return Recipe(
        patch=int(fields["patch"]),
        preprocessing=preprocessing,
        blocks=int(fields["blocks"]),
        basis=Basis(str(fields["basis_of"])),
        components=int(fields["components"]),
        energy=float(fields["energy"]),
        discriminative=bool(fields["discriminative"]),
        shrinkage=float(fields["shrinkage"]),
        views=Views(str(fields["views"])),
        metric=Metric(str(fields["metric"])),
    )


def _space_of(fields: dict[str, NDArray[Any]], recipe: Recipe) -> WaveletEigenSpace:
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
    if (
        not all(np.isfinite(array).all() for array in (means, basis, strengths, counts))
        or (counts <= 0).any()
    ):
        raise ValueError("values must be finite and the counts positive")
    ends = np.cumsum(ranks)
    spaces = tuple(
        Eigenspace(
            means[index].copy(), basis[end - rank : end], strengths[end - rank : end], float(counts[index])
        )
        for index, (rank, end) in enumerate(zip(ranks, ends, strict=True))
    )
    return WaveletEigenSpace(spaces, recipe, int(fields["version"]), _fisher_of(fields, recipe))


def _fisher_of(fields: dict[str, NDArray[Any]], recipe: Recipe) -> NDArray[np.float64] | None:
    if not recipe.discriminative:
        return None
    axes = np.array(fields["fisher_axes"], np.float64)
    length = recipe.blocks**2 * recipe.components
    if axes.ndim != 2 or axes.shape[0] != length or not np.isfinite(axes).all():
        raise ValueError(f"Fisher axes {axes.shape} must be finite and have {length} rows")
    return axes


def _gallery_of(fields: dict[str, NDArray[Any]], recipe: Recipe) -> Gallery:
    patches, labels = fields["gallery"], tuple(str(label) for label in fields["labels"])
    if not labels:
        return empty_gallery(recipe.patch)
    if patches.dtype != np.uint8 or patches.shape != (len(labels), *recipe.patch_size):
        raise ValueError(f"gallery {patches.dtype} {patches.shape} does not fit {len(labels)} labels")
    return Gallery(patches, labels)
