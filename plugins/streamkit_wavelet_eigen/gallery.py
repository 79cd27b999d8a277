"""Labelled windows, and the nearest of them to a feature vector."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, flat_windows
from streamkit_wavelet_eigen.recipe import Metric, Recipe
from streamkit_wavelet_eigen.virtual_views import prepared_views, view_count
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Values of all prepared windows and views together: 256 MB of float32.
LARGEST_VALUES = 64 * 1024 * 1024


@dataclass(frozen=True, eq=False)
class Gallery:
    """Windows with names; the windows are kept, so that any space can embed them again.

    Attributes:
        patches: uint8[m, h, w], grey levels.
        labels: m names.
    """

    patches: NDArray[np.uint8]
    labels: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def joined(self, patches: FloatBatch, label: str, limit: int) -> "Gallery":
        """This gallery with windows float32[n, h, w] of one name; no name has more than `limit`."""
        room = max(limit - self.labels.count(label), 0)
        added = np.rint(np.clip(patches[:room], 0.0, 255.0)).astype(np.uint8)
        if not len(added):
            return self
        return Gallery(np.concatenate([self.patches, added]), self.labels + (label,) * len(added))


def empty_gallery(patch: int) -> Gallery:
    """A gallery of windows of `patch` px, without any yet."""
    return Gallery(np.zeros((0, patch, patch), np.uint8), ())


@dataclass(frozen=True, eq=False)
class Matches:
    """The nearest label to each of n vectors.

    Attributes:
        labels: n names; "" where the vector is all zero (a flat window).
        distances: float64[n], to the nearest vector of that label; infinity without a label.
        margins: float64[n], 1 - distance / distance to the nearest other label, 0 to 1; with one label in
            the gallery there is nothing to compare with, and it is 0.
    """

    labels: tuple[str, ...]
    distances: NDArray[np.float64]
    margins: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PreparedGallery:
    """A gallery whose windows, and their virtual views, are prepared: what does not change with the space.

    Attributes:
        gallery: the labelled windows.
        prepared: float32[views, m, h, w].
        flat: bool[m], windows that show no structure.
    """

    gallery: Gallery
    prepared: FloatBatch
    flat: NDArray[np.bool_]

    def grown(self, gallery: Gallery, recipe: Recipe) -> "PreparedGallery":
        """The same for this gallery with more windows behind those it has; only the new ones are prepared.

        Raises:
            ValueError: there are too many windows.
        """
        added = Gallery(gallery.patches[len(self.gallery) :], gallery.labels[len(self.gallery) :])
        if not len(added):
            return self
        more = prepare_gallery(added, recipe)
        check_values(len(gallery), recipe)
        return PreparedGallery(
            gallery,
            np.concatenate([self.prepared, more.prepared], axis=1),
            np.concatenate([self.flat, more.flat]),
        )


def prepare_gallery(gallery: Gallery, recipe: Recipe) -> PreparedGallery:
    """Prepares the windows of a gallery and their views as a recipe says.

    Raises:
        ValueError: there are too many windows.
    """
    check_values(len(gallery), recipe)
    patches = gallery.patches.astype(np.float32)
    prepared = prepared_views(patches, recipe.views, recipe.preprocessing)
    shape = (view_count(recipe.views), len(gallery), *recipe.prepared_size)
    return PreparedGallery(gallery, prepared.reshape(shape), flat_windows(patches))


def check_values(windows: int, recipe: Recipe) -> None:
    """Refuses more windows than fit the memory set aside, 256 MB.

    Raises:
        ValueError: says how many values there are, and what makes them fewer.
    """
    values = windows * view_count(recipe.views) * recipe.block_values * recipe.blocks**2
    if values > LARGEST_VALUES:
        raise ValueError(
            f"labelled windows, their views and pixels make {values} values, at most {LARGEST_VALUES} are "
            "taken; give fewer windows, views=none or a higher approximation"
        )


class Recogniser:
    """Nearest neighbour on a gallery, in one space.

    Args:
        space: in which vectors are compared.
        known: at least one labelled window, prepared by the space's recipe.
    """

    def __init__(self, space: WaveletEigenSpace, known: PreparedGallery) -> None:
        views, windows = known.prepared.shape[:2]
        self.space, self.known = space, known
        prepared = known.prepared.reshape(views * windows, *known.prepared.shape[2:])
        self._vectors = space.vectors_of(prepared, np.tile(known.flat, views))
        names, index = np.unique(np.asarray(known.gallery.labels), return_inverse=True)
        self._names: list[str] = [str(name) for name in names]
        self._index = np.tile(index, views)

    def recognise(self, vectors: FloatBatch) -> Matches:
        """The nearest label to each feature vector, float32[n, length]."""
        recipe = self.space.recipe
        apart = distances(vectors, self._vectors, recipe.metric, recipe.blocks**2)
        by_name = np.full((len(vectors), len(self._names)), np.inf)
        for number in range(len(self._names)):
            by_name[:, number] = apart[:, self._index == number].min(axis=1)
        ordered = np.sort(by_name, axis=1)
        nearest = by_name.argmin(axis=1)
        first = ordered[:, 0]
        second = ordered[:, 1] if len(self._names) > 1 else first
        margins = 1.0 - np.divide(first, second, out=np.ones_like(first), where=second > 0)
        known: NDArray[np.bool_] = np.any(vectors != 0, axis=1)
        labels = tuple(
            self._names[number] if sure else "" for number, sure in zip(nearest, known, strict=True)
        )
        return Matches(labels, np.where(known, first, np.inf), np.where(known, margins, 0.0))


def distances(
    one: NDArray[np.floating], other: NDArray[np.floating], metric: Metric, parts: int = 1
) -> NDArray[np.float64]:
    """Distances float64[n, m] between the rows of float[n, k] and float[m, k].

    Args:
        one: float[n, k].
        other: float[m, k].
        metric: Euclidean; summed, over `parts` equal parts of the vectors; or 1 - cosine, where a zero vector
            is 1 from everything.
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
        mine, theirs = rows[:, first : first + width], columns[:, first : first + width]
        squares = np.sum(mine**2, axis=1)[:, None] + np.sum(theirs**2, axis=1) - 2.0 * mine @ theirs.T
        result += np.sqrt(np.maximum(squares, 0.0))
    return result


def _unit_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    result: NDArray[np.float64] = np.divide(rows, lengths, out=np.zeros_like(rows), where=lengths > 0)
    return result


def share_recognised(given: Sequence[str], truth: Sequence[str]) -> float:
    """Share of n labels that are right, 0 to 1."""
    return sum(one == other for one, other in zip(given, truth, strict=True)) / max(len(truth), 1)
