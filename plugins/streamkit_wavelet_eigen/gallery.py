"""Labelled windows, read from a folder or collected, and recognition by the nearest of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, flat_windows
from streamkit_wavelet_eigen.recipe import Metric, Recipe
from streamkit_wavelet_eigen.virtual_views import check_gallery_size, prepared_views, view_count
from streamkit_wavelet_eigen.wavelet import FloatBatch

IMAGE_SUFFIXES = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff", ".webp"}
MAX_IMAGES = 4096


@dataclass(frozen=True, eq=False)
class Gallery:
    """Labelled windows, kept as pixels so that any space can embed them again.

    Attributes:
        patches: uint8[m, h, w], grey levels.
        labels: m names.
    """

    patches: NDArray[np.uint8]
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def only(self, chosen: Sequence[bool]) -> "Gallery":
        """The windows where `chosen`, one for each, is set."""
        labels = (label for label, is_kept in zip(self.labels, chosen, strict=True) if is_kept)
        return Gallery(self.patches[np.asarray(chosen, bool)], tuple(labels))

    def with_windows(self, patches: FloatBatch, label: str, limit: int) -> "Gallery":
        """This gallery and windows float32[n, h, w] of one label, up to `limit` of that label."""
        room = max(limit - self.labels.count(label), 0)
        added = np.rint(np.clip(patches[:room], 0.0, 255.0)).astype(np.uint8)
        if not len(added):
            return self
        return Gallery(np.concatenate([self.patches, added]), self.labels + (label,) * len(added))


def empty_gallery(patch: int) -> Gallery:
    """A gallery for windows of `patch` px, without windows."""
    return Gallery(np.zeros((0, patch, patch), np.uint8), ())


def read_gallery(folder: Path, patch: int) -> Gallery:
    """Reads `folder/LABEL/IMAGE`; each image is a window, scaled to `patch` px.

    Raises:
        ValueError: there is no image, one cannot be read, or there are more than 4096.
        OSError: the folder cannot be read.
    """
    paths = [
        path
        for label in sorted(entry for entry in folder.iterdir() if entry.is_dir())
        for path in sorted(label.iterdir())
        if path.suffix.lower() in IMAGE_SUFFIXES
    ]
    if not 0 < len(paths) <= MAX_IMAGES:
        raise ValueError(
            f"{folder}: a gallery has 1 to {MAX_IMAGES} images in folders named after their labels, "
            f"got {len(paths)}"
        )
    windows = np.stack([read_window(path, patch) for path in paths])
    return Gallery(windows, tuple(path.parent.name for path in paths))


def read_window(path: Path, patch: int) -> NDArray[np.uint8]:
    """An image file in grey levels, scaled to uint8[patch, patch].

    Raises:
        ValueError: it is not an image that can be read.
        OSError: it cannot be opened.
    """
    encoded = np.fromfile(path, np.uint8)
    image = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE) if len(encoded) else None
    if image is None:
        raise ValueError(f"{path}: not an image that can be read; remove it or save it as PNG")
    interpolation = cv2.INTER_AREA if max(image.shape) > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (patch, patch), interpolation=interpolation), np.uint8)


@dataclass(frozen=True, eq=False)
class Matches:
    """The nearest label to each of n vectors.

    Attributes:
        labels: n names; "" where the vector is all zero (a flat window).
        distances: float64[n], to the nearest vector of that label; infinity without a label.
        margins: float64[n], 1 - distance / distance to the nearest other label, 0 to 1; 0 where the gallery
            has one label only.
    """

    labels: tuple[str, ...]
    distances: NDArray[np.float64]
    margins: NDArray[np.float64]


class Recogniser:
    """Nearest neighbour in a gallery; its prepared windows and virtual views are kept for every space.

    Args:
        recipe: how windows are prepared, as in the spaces that vectors come from.
        gallery: the labelled windows.

    Attributes:
        gallery: the labelled windows, and those of `extend`.

    Raises:
        ValueError: there are too many windows.
    """

    def __init__(self, recipe: Recipe, gallery: Gallery) -> None:
        self._recipe, self._views = recipe, view_count(recipe.views)
        self._prepared = np.zeros((self._views, 0, *recipe.prepared_size), np.float32)
        self._flat = np.zeros(0, bool)
        self.extend(gallery)

    def extend(self, gallery: Gallery) -> None:
        """Takes a gallery whose first windows are those of the last one, and prepares the others.

        Raises:
            ValueError: there are too many windows.
        """
        check_gallery_size(len(gallery), self._recipe)
        patches = gallery.patches[len(self._flat) :].astype(np.float32)
        prepared = prepared_views(patches, self._recipe.views, self._recipe.preprocessing)
        prepared = prepared.reshape(self._views, len(patches), *self._recipe.prepared_size)
        self._prepared = np.concatenate([self._prepared, prepared], axis=1)
        self._flat = np.concatenate([self._flat, flat_windows(patches)])
        self.gallery = gallery
        self._space: WaveletEigenSpace | None = None  # of `_vectors`
        self._names, index = np.unique(np.asarray(gallery.labels), return_inverse=True)
        self._index = np.tile(index, self._views)

    def _embed(self, space: WaveletEigenSpace) -> FloatBatch:
        """The vectors of all windows and views, which change with the space and the gallery."""
        if self._space is not space:
            prepared = self._prepared.reshape(-1, *self._recipe.prepared_size)
            self._space = space
            self._vectors = space.project(prepared, np.tile(self._flat, self._views)).vectors
        return self._vectors

    def recognise(self, vectors: FloatBatch, space: WaveletEigenSpace) -> Matches:
        """The nearest label to each feature vector of a space, float32[n, length]; needs a gallery."""
        to_gallery = distances(vectors, self._embed(space), self._recipe.metric, self._recipe.blocks**2)
        to_label = np.full((len(vectors), len(self._names)), np.inf)
        for number in range(len(self._names)):
            to_label[:, number] = to_gallery[:, self._index == number].min(axis=1)
        ordered = np.sort(to_label, axis=1)
        nearest = to_label.argmin(axis=1)
        first = ordered[:, 0]
        second = ordered[:, 1] if len(self._names) > 1 else first
        margins = 1.0 - np.divide(first, second, out=np.ones_like(first), where=second > 0)
        valid: NDArray[np.bool_] = np.any(vectors != 0, axis=1)
        labels = tuple(str(name) if ok else "" for name, ok in zip(self._names[nearest], valid, strict=True))
        return Matches(labels, np.where(valid, first, np.inf), np.where(valid, margins, 0.0))


def distances(
    one: NDArray[np.floating], other: NDArray[np.floating], metric: Metric, parts: int = 1
) -> NDArray[np.float64]:
    """Distances float64[n, m] between the rows of float[n, k] and float[m, k].

    Args:
        one: float[n, k].
        other: float[m, k].
        metric: Euclidean; summed, over `parts` equal parts of the vectors; or 1 - cosine, where a zero vector
            has distance 1 to all vectors.
        parts: blocks in a vector.
    """
    rows: NDArray[np.float64] = np.asarray(one, np.float64)
    columns: NDArray[np.float64] = np.asarray(other, np.float64)
    if metric is Metric.COSINE:
        return np.asarray(1.0 - _unit_rows(rows) @ _unit_rows(columns).T)
    if metric is Metric.EUCLIDEAN or rows.shape[1] % parts:
        parts = 1
    result = np.zeros((len(rows), len(columns)))
    width = rows.shape[1] // parts
    for first in range(0, parts * width, max(width, 1)):
        left, right = rows[:, first : first + width], columns[:, first : first + width]
        squares = np.sum(left**2, axis=1)[:, None] + np.sum(right**2, axis=1) - 2.0 * left @ right.T
        result += np.sqrt(np.maximum(squares, 0.0))
    return result


def _unit_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    result: NDArray[np.float64] = np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)
    return result
