"""Principal rows against numpy's singular value decomposition."""

import numpy as np
import pytest

from streamkit_tracker.appearance.principal_rows import principal_rows


def rows_of(strengths: np.ndarray, length: int = 64) -> np.ndarray:
    """Rows whose singular values are given."""
    generator = np.random.default_rng(len(strengths))
    left = np.linalg.qr(generator.normal(size=(len(strengths), len(strengths))))[0]
    right = np.linalg.qr(generator.normal(size=(length, len(strengths))))[0]
    return np.asarray((left * strengths) @ right.T, np.float32)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 23, 40])
def test_directions_and_strengths_are_those_of_the_decomposition(count: int) -> None:
    """Strongest first, orthonormal, each the singular vector but for its sign."""
    rows = rows_of(np.geomspace(50.0, 2.0, count))
    basis, values = np.empty((16, 64), np.float32), np.empty(16, np.float32)
    kept = principal_rows(rows, basis, values)
    assert kept == min(count, 16)
    _, expected, directions = np.linalg.svd(rows.astype(np.float64), full_matrices=False)
    np.testing.assert_allclose(values[:kept], expected[:kept], rtol=1e-5)
    along = np.abs(np.sum(basis[:kept] * directions[:kept], axis=1))
    np.testing.assert_allclose(along, 1.0, atol=1e-4)
    np.testing.assert_allclose(basis[:kept] @ basis[:kept].T, np.eye(kept), atol=1e-4)


def test_what_is_rounding_is_left_out() -> None:
    """Repeated and empty rows add no direction."""
    rows = np.repeat(rows_of(np.array([9.0, 4.0, 1.0])), 3, axis=0)
    rows[4] = 0.0
    basis, values = np.empty((9, 64), np.float32), np.empty(9, np.float32)
    assert principal_rows(rows, basis, values) == 3
    assert principal_rows(np.zeros((4, 64), np.float32), basis, values) == 0


def test_equal_strengths_have_any_orthonormal_directions() -> None:
    """Rows that are orthonormal already span the same space."""
    rows = rows_of(np.ones(6))
    basis, values = np.empty((6, 64), np.float32), np.empty(6, np.float32)
    assert principal_rows(rows, basis, values) == 6
    np.testing.assert_allclose(values, 1.0, rtol=1e-5)
    np.testing.assert_allclose(basis.T @ basis, rows.T @ rows, atol=1e-5)
