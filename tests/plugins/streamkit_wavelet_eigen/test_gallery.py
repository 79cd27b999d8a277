"""The nearest labelled window, by three metrics, with its margin; and the folder it may come from."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy

from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, learn_space
from streamkit_wavelet_eigen.gallery import (
    Gallery,
    Recogniser,
    distances,
    empty_gallery,
    read_gallery,
)
from streamkit_wavelet_eigen.recipe import Metric, Mode, Preprocessing, Recipe, Views

RAW = Preprocessing(Mode.RAW)


def _windows(count: int, side: int = 16, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(20, 230, (count, side, side)).astype(np.float32)


def _recogniser(
    recipe: Recipe, names: str = "abcabcabcabc"
) -> tuple[Recogniser, WaveletEigenSpace, np.ndarray]:
    base = dict(zip("abc", _windows(3, recipe.patch), strict=True))
    noise = np.random.default_rng(5).normal(0, 12, (len(names), recipe.patch, recipe.patch))
    patches = np.stack([base[name] for name in names]) + noise
    patches = np.clip(patches, 0, 255).astype(np.uint8)
    space = learn_space(patches.astype(np.float32), recipe, names)
    return Recogniser(recipe, Gallery(patches, tuple(names))), space, np.stack(list(base.values()))


@pytest.mark.parametrize(
    "recipe",
    [
        Recipe(16, RAW, components=6),
        Recipe(16, RAW, blocks=4, components=3, metric=Metric.SUMMED),
        Recipe(16, RAW, components=6, metric=Metric.COSINE),
        Recipe(16, RAW, components=6, discriminative=True, views=Views.MIRRORED),
    ],
    ids=["euclidean", "summed", "cosine", "fisher"],
)
def test_targets_get_their_own_label(recipe: Recipe) -> None:
    """Each clean window is nearest to the noisy ones of its own name."""
    recogniser, space, probes = _recogniser(recipe)
    matches = recogniser.recognise(space.embed(probes), space)
    assert matches.labels == ("a", "b", "c")
    assert np.isfinite(matches.distances).all()
    assert (matches.margins > 0.3).all()


def test_a_flat_window_has_no_label() -> None:
    """A zero vector is no target: no label, infinitely far, no margin."""
    recogniser, space, probes = _recogniser(Recipe(16, RAW, components=6))
    probes[1] = 90.0
    matches = recogniser.recognise(space.embed(probes), space)
    assert matches.labels == ("a", "", "c")
    assert matches.distances[1] == np.inf
    assert matches.margins[1] == 0.0


def test_margins_compare_with_the_next_label() -> None:
    """A window half way between two targets has a margin near zero; one label alone has none."""
    recogniser, space, probes = _recogniser(Recipe(16, RAW, components=6))
    between = space.embed((probes[:1] + probes[1:2]) / 2)
    assert recogniser.recognise(between, space).margins[0] < 0.1
    alone, space, probes = _recogniser(Recipe(16, RAW, components=6), "aaaa")
    assert alone.recognise(space.embed(probes), space).margins.tolist() == [0.0, 0.0, 0.0]


def test_no_vector_has_no_match() -> None:
    """An empty frame is no error."""
    recogniser, space, _ = _recogniser(Recipe(16, RAW, components=6))
    assert recogniser.recognise(np.zeros((0, 6), np.float32), space).labels == ()


@pytest.mark.parametrize(("metric", "name"), [(Metric.EUCLIDEAN, "euclidean"), (Metric.COSINE, "cosine")])
def test_distances_are_those_of_scipy(metric: Metric, name: str) -> None:
    """Euclidean and cosine distances of all pairs."""
    one, other = (np.random.default_rng(seed).normal(size=(count, 12)) for seed, count in ((1, 5), (2, 7)))
    np.testing.assert_allclose(
        distances(one, other, metric), scipy.spatial.distance.cdist(one, other, name), atol=1e-6
    )


def test_summed_distances_add_the_blocks() -> None:
    """The sum over blocks of Euclidean distances, not the distance of the whole."""
    one, other = (np.random.default_rng(seed).normal(size=(count, 12)) for seed, count in ((1, 5), (2, 7)))
    expected = sum(
        scipy.spatial.distance.cdist(one[:, first : first + 3], other[:, first : first + 3])
        for first in range(0, 12, 3)
    )
    np.testing.assert_allclose(distances(one, other, Metric.SUMMED, 4), expected, atol=1e-6)


def test_a_gallery_is_bounded() -> None:
    """Of each name at most `limit` windows are kept; other names are not touched."""
    gallery = empty_gallery(16).with_windows(_windows(5), "car", 8).with_windows(_windows(9), "car", 8)
    assert gallery.labels == ("car",) * 8
    assert gallery.with_windows(_windows(1), "car", 8) is gallery
    assert gallery.with_windows(_windows(2), "van", 8).labels == ("car",) * 8 + ("van",) * 2


@pytest.mark.parametrize("views", list(Views))
def test_a_grown_gallery_is_the_whole_one(views: Views) -> None:
    """Preparing only what is new gives what preparing everything gives; nothing new changes nothing."""
    recipe = Recipe(16, Preprocessing(Mode.PAPER), components=4, views=views)
    first = empty_gallery(16).with_windows(_windows(3), "car", 9)
    more = first.with_windows(_windows(2, seed=4), "van", 9)
    grown, whole, from_empty = (Recogniser(recipe, known) for known in (first, more, empty_gallery(16)))
    grown.extend(more)
    from_empty.extend(more)
    np.testing.assert_allclose(grown._prepared, whole._prepared, atol=1e-3)
    assert grown.gallery.labels == ("car", "car", "car", "van", "van")
    assert from_empty._prepared.shape == whole._prepared.shape


def test_too_large_a_gallery_is_refused() -> None:
    """More values than fit the memory set aside are refused before they are made."""
    patches = np.broadcast_to(np.zeros((1, 64, 64), np.uint8), (4096, 64, 64))
    with pytest.raises(ValueError, match="fewer windows, views=none"):
        Recogniser(Recipe(64, RAW, views=Views.MIRRORED), Gallery(patches, ("car",) * 4096))


def test_a_folder_is_a_gallery(tmp_path: Path) -> None:
    """Folders are labels, images of any size windows; other files do not count."""
    for label, size in (("car", 40), ("van", 16)):
        (tmp_path / label).mkdir()
        for number in range(2):
            image = np.full((size, size), 60 * number + 50, np.uint8)
            cv2.imwrite(str(tmp_path / label / f"{number}.png"), image)
    (tmp_path / "car" / "notes.txt").write_text("red")
    (tmp_path / "readme.md").write_text("two cars")
    gallery = read_gallery(tmp_path, 16)
    assert gallery.labels == ("car", "car", "van", "van")
    assert gallery.patches[:, 0, 0].tolist() == [50, 110, 50, 110]
    assert gallery.patches.shape == (4, 16, 16)


@pytest.mark.parametrize("content", [b"", b"no image"])
def test_a_broken_image_is_named(tmp_path: Path, content: bytes) -> None:
    """The error says which file to remove."""
    (tmp_path / "car").mkdir()
    (tmp_path / "car" / "1.png").write_bytes(content)
    with pytest.raises(ValueError, match=r"car/1\.png: not an image"):
        read_gallery(tmp_path, 16)


def test_a_folder_without_images_is_refused(tmp_path: Path) -> None:
    """The error says how the folder is to be laid out."""
    with pytest.raises(ValueError, match="folders named after their labels, got 0"):
        read_gallery(tmp_path, 16)
