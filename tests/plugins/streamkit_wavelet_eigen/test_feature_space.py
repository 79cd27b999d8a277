"""The snapshot embeds windows: whole, in blocks of one basis or one each, with or without a Fisher step."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.eigenspace import learn_eigenspace
from streamkit_wavelet_eigen.feature_space import (
    FLAT_DEVIATION,
    WaveletEigenSpace,
    cut_blocks,
    flat_windows,
    learn_space,
)
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Basis, Mode, Preprocessing, Recipe


def _windows(count: int, side: int = 16, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, side, side)).astype(np.float32)


def _recipe(
    mode: Mode = Mode.RAW, components: int = 4, blocks: int = 1, basis: Basis = Basis.SHARED
) -> Recipe:
    return Recipe(16, Preprocessing(mode), blocks, basis, components)


def _learnt(mode: Mode = Mode.RAW, components: int = 4, count: int = 12) -> WaveletEigenSpace:
    return learn_space(_windows(count), _recipe(mode, components))


@pytest.mark.parametrize("mode", list(Mode))
def test_embedding_is_the_projection_of_the_prepared_window(mode: Mode) -> None:
    """`embed` prepares, makes vectors and projects: float32[n, components]."""
    space, given = _learnt(mode), _windows(5, seed=8)
    prepared = prepare(given, space.recipe.preprocessing).reshape(5, -1).astype(np.float64)
    embedded = space.embed(given)
    assert embedded.dtype == np.float32
    np.testing.assert_allclose(embedded, space.spaces[0].project(prepared), atol=0.05)


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


def test_rounding_does_not_decide_on_windows_at_the_limit() -> None:
    """A window is flat by its exact deviation, where it is cut and where it is embedded."""
    given = np.random.default_rng(0).standard_normal((1000, 32, 32))
    deviations = given.std(axis=(1, 2), keepdims=True)
    at_limit = (128 + given * (FLAT_DEVIATION / deviations)).astype(np.float32)
    exact = at_limit.astype(np.float64).std(axis=(1, 2)) < FLAT_DEVIATION
    np.testing.assert_array_equal(flat_windows(at_limit), exact)


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
    """The error names the expected size and the shape it got."""
    with pytest.raises(ValueError, match=r"float32\[n, 16, 16\], got shape"):
        _learnt().embed(np.zeros(shape, np.float32))


@pytest.mark.parametrize("basis", list(Basis))
def test_blocks_are_projected_each(basis: Basis) -> None:
    """The vector is the blocks' coordinates one after the other, on the shared basis or on their own."""
    recipe = _recipe(blocks=4, components=3, basis=basis)
    training, given = _windows(20), _windows(5, seed=3)
    embedded = learn_space(training, recipe).embed(given)
    assert embedded.shape == (5, 16 * 3)
    blocks, probes = (cut_blocks(windows, 4).astype(np.float64) for windows in (training, given))
    for index in range(16):
        rows = blocks[:, index] if basis is Basis.PER_BLOCK else blocks.reshape(-1, 16)
        expected = learn_eigenspace(rows, 3).project(probes[:, index])
        np.testing.assert_allclose(embedded[:, 3 * index : 3 * index + 3], expected, atol=0.05)


@pytest.mark.parametrize(("blocks", "basis"), [(1, Basis.SHARED), (4, Basis.SHARED), (4, Basis.PER_BLOCK)])
def test_error_and_energy_are_those_of_the_reconstruction(blocks: int, basis: Basis) -> None:
    """The error of a vector is the distance to the reconstructed window; energy is the share kept."""
    space = learn_space(_windows(30), _recipe(blocks=blocks, components=5, basis=basis))
    given = _windows(6, seed=9)
    projection = space.project(given, np.zeros(6, bool))
    missed = given - space.reconstruct(given)
    np.testing.assert_allclose(projection.errors, np.sqrt(np.mean(missed**2, axis=(1, 2))), rtol=1e-4)
    means = space.reconstruct(given) * 0 + _mean_window(space)
    spread = np.sum((given - means) ** 2, axis=(1, 2))
    np.testing.assert_allclose(projection.energy, 1 - np.sum(missed**2, axis=(1, 2)) / spread, atol=1e-4)


def _mean_window(space: WaveletEigenSpace) -> np.ndarray:
    empty = replace(space, spaces=tuple(replace(part, basis=part.basis[:0].copy(),
                    singular_values=part.singular_values[:0].copy()) for part in space.spaces))  # fmt: skip
    return empty.reconstruct(np.zeros((1, 16, 16), np.float32))


def test_training_windows_come_back_whole_from_all_components() -> None:
    """With as many eigenvectors as windows there is nothing left out: error 0, energy 1."""
    given = _windows(8)
    space = learn_space(given, _recipe(components=16))
    projection = space.project(given, np.zeros(8, bool))
    assert projection.errors.max() < 0.1
    np.testing.assert_allclose(projection.energy, 1.0, atol=1e-4)
    np.testing.assert_allclose(space.reconstruct(given), given, atol=0.05)


def test_energy_keeps_the_fewest_eigenvectors() -> None:
    """Half of the variance needs fewer than all of it; the length of a vector stays."""
    given = _windows(30)
    whole, half = (learn_space(given, replace(_recipe(components=29), energy=share)) for share in (1.0, 0.5))
    assert whole.rank == 29
    held = np.cumsum(whole.spaces[0].singular_values ** 2)
    assert half.rank == int(np.searchsorted(held, held[-1] / 2)) + 1
    assert half.embed(given).shape == (30, 29)


def test_a_fisher_step_shortens_the_vectors() -> None:
    """With 4 labels there are 3 axes, whatever the eigenvectors."""
    given = _windows(16)
    labels = [f"class {number % 4}" for number in range(16)]
    space = learn_space(given, replace(_recipe(components=8), discriminative=True), labels)
    assert (space.length, space.embed(given).shape) == (3, (16, 3))


@pytest.mark.parametrize(("mode", "least"), [(Mode.RAW, 0.88), (Mode.PAPER, 0.85)])
def test_faces_are_recognised(streamkit_data: Path, mode: Mode, least: float) -> None:
    """ORL, 5 training images, 40 components, nearest neighbour: near the published 93 and 91 %."""
    images = np.stack(
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
    space = learn_space(images[training], Recipe(64, how, components=40))
    gallery, probes = space.embed(images[training]), space.embed(images[~training])
    nearest = ((probes[:, None] - gallery[None]) ** 2).sum(axis=2).argmin(axis=1)
    labels = np.repeat(np.arange(40), 10)
    assert (labels[training][nearest] == labels[~training]).mean() >= least
