"""The Fisher step is linear discriminant analysis, and refuses what it cannot learn from."""

import numpy as np
import pytest

from streamkit_wavelet_eigen.eigenspace import learn_fisher_axes


def _classes(
    count: int = 12, classes: int = 4, length: int = 6, seed: int = 0
) -> tuple[np.ndarray, list[str]]:
    generator = np.random.default_rng(seed)
    centres = 6 * generator.normal(size=(classes, length))
    vectors = np.repeat(centres, count, axis=0) + generator.normal(
        size=(classes * count, length)
    ) * np.arange(1, length + 1)
    return vectors, [f"class {number}" for number in np.repeat(np.arange(classes), count)]


def test_axes_span_those_of_scikit_learn() -> None:
    """Without shrinkage the axes span scikit-learn's discriminant space."""
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    vectors, labels = _classes()
    ours = learn_fisher_axes(vectors, labels, shrinkage=0.0)
    theirs = LinearDiscriminantAnalysis(solver="eigen").fit(vectors, labels).scalings_[:, :3]
    cosines = np.linalg.svd(np.linalg.qr(ours)[0].T @ np.linalg.qr(theirs)[0], compute_uv=False)
    assert ours.shape == (6, 3)
    np.testing.assert_allclose(cosines, 1.0, atol=1e-6)


def test_scatter_within_classes_is_one_along_each_axis() -> None:
    """Axes are scaled so that no class is wide in one direction and narrow in another."""
    vectors, labels = _classes()
    projected = vectors @ learn_fisher_axes(vectors, labels, shrinkage=0.0)
    names = np.array(labels)
    inner = np.concatenate(
        [projected[names == name] - projected[names == name].mean(axis=0) for name in set(labels)]
    )
    np.testing.assert_allclose(inner.T @ inner / len(inner), np.eye(3), atol=1e-6)


def test_shrinkage_makes_more_dimensions_than_windows_possible() -> None:
    """With 6 windows of 40 values the scatter is singular; shrunk, the axes are finite and separate."""
    vectors, labels = _classes(count=3, classes=2, length=40)
    projected = vectors @ learn_fisher_axes(vectors, labels, shrinkage=0.1)
    assert projected.shape == (6, 1)
    assert abs(projected[:3].mean() - projected[3:].mean()) > 3 * projected[:3].std()


def test_equal_windows_give_finite_axes() -> None:
    """Classes without any scatter are no reason to divide by zero."""
    vectors = np.repeat(np.eye(3), 2, axis=0)
    assert np.isfinite(learn_fisher_axes(vectors, ["a", "a", "b", "b", "c", "c"])).all()
    assert np.isfinite(learn_fisher_axes(np.zeros((4, 3)), ["a", "a", "b", "b"])).all()


@pytest.mark.parametrize("labels", [["a", "a", "a"], ["a", "b", "c"]])
def test_labels_that_say_nothing_are_refused(labels: list[str]) -> None:
    """One class, or one window of each, leaves nothing to compare."""
    with pytest.raises(ValueError, match="at least two labels are needed, and two windows of one"):
        learn_fisher_axes(np.eye(3), labels)
