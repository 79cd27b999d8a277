"""Batch components equal the singular value decomposition; incremental ones follow the batch."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy

from streamkit_wavelet_eigen.eigenspace import Eigenspace, learn_eigenspace, update_eigenspace


def _low_rank(count: int, length: int, rank: int, seed: int = 0, noise: float = 0.0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    directions = np.random.default_rng(99).normal(size=(rank, length)) * (2.0 ** -np.arange(rank))[:, None]
    return (
        100
        + 10 * generator.normal(size=(count, rank)) @ directions
        + noise * generator.normal(size=(count, length))
    )


def _largest_angle(one: np.ndarray, other: np.ndarray) -> float:
    cosines = np.linalg.svd(one @ other.T, compute_uv=False)
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1, 1))))


def _eigenvalues(space: Eigenspace) -> np.ndarray:
    return space.singular_values**2 / space.count


def _assert_orthonormal(space: Eigenspace) -> None:
    np.testing.assert_allclose(space.basis @ space.basis.T, np.eye(space.rank), atol=1e-8)


@pytest.mark.parametrize(("count", "length"), [(20, 100), (100, 20), (30, 30)])
def test_batch_equals_svd(count: int, length: int) -> None:
    """Mean, eigenvectors and eigenvalues are those of the covariance of equation 6, never formed."""
    vectors = _low_rank(count, length, 6, noise=0.1)
    space = learn_eigenspace(vectors, 5)
    centred = vectors - vectors.mean(axis=0)
    _, singular, right = np.linalg.svd(centred, full_matrices=False)
    np.testing.assert_allclose(space.mean, vectors.mean(axis=0))
    np.testing.assert_allclose(space.singular_values, singular[:5], rtol=1e-9)
    np.testing.assert_allclose(_eigenvalues(space), np.linalg.eigvalsh(centred.T @ centred / count)[::-1][:5])
    assert _largest_angle(space.basis, right[:5]) < 1e-3
    _assert_orthonormal(space)


def test_weak_directions_are_dropped() -> None:
    """Singular values below 1e-3 of the largest carry no appearance and are left out."""
    space = learn_eigenspace(_low_rank(40, 200, 3), 16)
    assert space.rank == 3
    faint = _low_rank(40, 200, 3)
    faint += 1e-7 * np.random.default_rng(4).normal(size=faint.shape)
    assert learn_eigenspace(faint, 16).rank == 3


@pytest.mark.parametrize("vectors", [np.full((1, 9), 7.0), np.full((5, 9), 7.3), np.zeros((3, 9))])
def test_one_or_equal_vectors_have_a_mean_only(vectors: np.ndarray) -> None:
    """Without variation there is no eigenvector, and projection gives no coordinate."""
    space = learn_eigenspace(vectors, 4)
    assert space.rank == 0
    np.testing.assert_allclose(space.mean, vectors[0])
    assert space.project(vectors).shape == (len(vectors), 0)
    np.testing.assert_allclose(space.reconstruct(space.project(vectors)), vectors)


def test_restore_undoes_project_within_the_space() -> None:
    """Vectors of rank k come back from k coordinates."""
    vectors = _low_rank(30, 80, 4)
    space = learn_eigenspace(vectors, 4)
    np.testing.assert_allclose(space.reconstruct(space.project(vectors)), vectors, atol=1e-6)


def test_incremental_without_forgetting_equals_batch() -> None:
    """With room for every direction, updates in batches equal one batch of everything."""
    vectors = _low_rank(60, 120, 5)
    space = learn_eigenspace(vectors[:7], 8)
    for first in range(7, 60, 11):
        space = update_eigenspace(space, vectors[first : first + 11], 8)
    whole = learn_eigenspace(vectors, 8)
    assert space.count == 60
    np.testing.assert_allclose(space.mean, whole.mean, atol=1e-9)
    np.testing.assert_allclose(space.singular_values, whole.singular_values, rtol=1e-6)
    assert _largest_angle(space.basis, whole.basis) < 0.01
    _assert_orthonormal(space)


def test_truncated_incremental_stays_near_batch() -> None:
    """After 200 noisy vectors in batches of 5, the first 8 principal angles stay within 5 degrees."""
    vectors = _low_rank(200, 256, 8, noise=0.02)
    space = learn_eigenspace(vectors[:10], 16)
    for first in range(10, 200, 5):
        space = update_eigenspace(space, vectors[first : first + 5], 16)
    whole = learn_eigenspace(vectors, 16)
    assert _largest_angle(space.basis[:8], whole.basis[:8]) <= 5.0


def test_update_from_a_mean_alone() -> None:
    """A space of one vector learns its first direction from the next ones."""
    vectors = _low_rank(12, 40, 3)
    space = update_eigenspace(learn_eigenspace(vectors[:1], 6), vectors[1:], 6)
    whole = learn_eigenspace(vectors, 6)
    np.testing.assert_allclose(space.singular_values, whole.singular_values, rtol=1e-6)


def test_forgetting_follows_the_newest() -> None:
    """With forgetting the mean moves to the new appearance and the count stays bounded."""
    old, new = _low_rank(50, 30, 2, seed=1), _low_rank(50, 30, 2, seed=2) + 50
    keeping = forgetting = learn_eigenspace(old, 4)
    for first in range(0, 50, 5):
        keeping = update_eigenspace(keeping, new[first : first + 5], 4, 1.0)
        forgetting = update_eigenspace(forgetting, new[first : first + 5], 4, 0.5)
    goal = new.mean(axis=0)
    assert np.abs(forgetting.mean - goal).mean() < 0.2 * np.abs(keeping.mean - goal).mean()
    assert forgetting.count < 11


def test_signs_are_repeatable() -> None:
    """The largest element of each eigenvector is positive, so equal input gives equal output."""
    space = learn_eigenspace(_low_rank(30, 50, 4), 4)
    strongest = np.abs(space.basis).argmax(axis=1)
    assert (space.basis[np.arange(space.rank), strongest] > 0).all()


def test_space_is_read_only() -> None:
    """A snapshot cannot be changed behind its users' backs."""
    space = learn_eigenspace(_low_rank(10, 20, 2), 2)
    for array in (space.mean, space.basis, space.singular_values):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(
    ("vectors", "text"),
    [
        (np.zeros((0, 4)), "m >= 1"),
        (np.zeros(4), "m >= 1"),
        (np.full((2, 4), np.nan), "finite"),
        (np.full((2, 4), np.inf), "finite"),
    ],
)
def test_unusable_vectors_are_refused(vectors: np.ndarray, text: str) -> None:
    """No vector, or one with NaN or infinity, is refused before it spoils the space."""
    with pytest.raises(ValueError, match=text):
        learn_eigenspace(vectors, 3)
    with pytest.raises(ValueError, match=text):
        update_eigenspace(learn_eigenspace(np.eye(4), 3), vectors, 3)


def test_update_with_another_length_is_refused() -> None:
    """Vectors of another patch size name both lengths."""
    with pytest.raises(ValueError, match="must have 4 values as the space has, got 5"):
        update_eigenspace(learn_eigenspace(np.eye(4), 3), np.zeros((2, 5)), 3)


def _faces(folder: Path) -> np.ndarray:
    """All 400 ORL faces, 32 by 32, as vectors, person by person turned into a stream of all."""
    images = [
        cv2.resize(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), (32, 32), interpolation=cv2.INTER_AREA)
        for person in range(1, 41)
        for path in (folder / "orl" / f"s{person}" / f"{view}.pgm" for view in range(1, 11))
    ]
    return np.stack(images).reshape(400, -1).astype(np.float64)


def test_subspaces_are_those_of_scikit_learn(streamkit_data: Path) -> None:
    """Equations 5 and 6 on faces: mean, variances and the angles between subspaces within 1e-5."""
    from sklearn.decomposition import PCA

    vectors = _faces(streamkit_data)[::2]
    space, theirs = learn_eigenspace(vectors, 40), PCA(40, svd_solver="full").fit(vectors)
    np.testing.assert_allclose(space.mean, theirs.mean_, atol=1e-5)
    # scikit-learn divides by M - 1, equation 6 by M.
    np.testing.assert_allclose(_eigenvalues(space), theirs.explained_variance_ * 199 / 200, rtol=1e-6)
    assert scipy.linalg.subspace_angles(space.basis.T, theirs.components_.T).max() <= 1e-5


def test_energy_is_held_by_the_fewest() -> None:
    """No smaller number of eigenvectors keeps the requested share."""
    vectors = _low_rank(60, 100, 12, noise=0.05)
    whole = learn_eigenspace(vectors, 59)
    held = np.cumsum(_eigenvalues(whole)) / _eigenvalues(whole).sum()
    for share in (0.3, 0.9, 0.99):
        rank = learn_eigenspace(vectors, 59, share).rank
        assert held[rank - 1] >= share - 1e-4
        assert rank == 1 or held[rank - 2] < share
    assert learn_eigenspace(vectors, 2, 0.99).rank == 2


def test_reconstruction_errors_are_the_distance_to_the_space() -> None:
    """What lies in the space has error 0; what is orthogonal to it has its own length."""
    space = learn_eigenspace(_low_rank(30, 80, 4), 4)
    inside = space.reconstruct(np.array([[3.0, -2.0, 1.0, 0.5]]))
    orthogonal = np.random.default_rng(1).normal(size=80)
    orthogonal -= space.basis.T @ (space.basis @ orthogonal)
    vectors = np.concatenate([inside, inside + orthogonal])
    residuals = vectors - space.reconstruct(space.project(vectors))
    errors = np.sqrt(np.mean(residuals**2, axis=1))
    np.testing.assert_allclose(errors, [0.0, np.sqrt(np.mean(orthogonal**2))], atol=1e-9)


def test_the_leading_part_is_a_smaller_batch() -> None:
    """Cutting a space to 3 eigenvectors gives the space learnt with 3."""
    vectors = _low_rank(30, 80, 6, noise=0.1)
    cut, small = learn_eigenspace(vectors, 9).truncated(3), learn_eigenspace(vectors, 3)
    np.testing.assert_allclose(cut.basis, small.basis)
    np.testing.assert_allclose(cut.singular_values, small.singular_values)
    whole = learn_eigenspace(vectors, 9)
    assert whole.truncated(9) is whole
    assert whole.truncated(9, 0.5).rank == learn_eigenspace(vectors, 9, 0.5).rank
