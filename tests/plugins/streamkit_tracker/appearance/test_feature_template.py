"""Templates in a travelling feature space."""

import numpy as np
import pytest

from streamkit_tracker.appearance.feature_template import FeatureTemplate, unit_rows


class Projection:
    """A feature space by random projection; another version is another projection."""

    patch_size = (8, 6)

    def __init__(self, version: int) -> None:
        self.version = version
        self._matrix = np.random.default_rng(version).standard_normal((48, 10)).astype(np.float32)

    def embed(self, patches: np.ndarray) -> np.ndarray:
        assert patches.shape[1:] == self.patch_size
        return (patches.reshape(len(patches), -1) - 128) @ self._matrix


@pytest.fixture
def some_patches() -> np.ndarray:
    """Four unrelated patches."""
    return (30 * np.random.default_rng(0).standard_normal((4, 48))).astype(np.float32)


def test_the_first_patch_is_at_distance_zero(some_patches: np.ndarray):
    """The target itself is at 0, others are not, and contrast does not count."""
    template = FeatureTemplate(some_patches[0], Projection(1))
    query = np.stack([some_patches[0], 2 * some_patches[0], some_patches[1]])[None]
    distances = FeatureTemplate.distances([template], query)[0]
    np.testing.assert_allclose(distances[:2], 0.0, atol=1e-4)
    assert distances[2] > 0.3


def test_a_new_version_of_the_space_is_followed(some_patches: np.ndarray):
    """Vectors of two versions are never compared: the template embeds its patches again."""
    template = FeatureTemplate(some_patches[0], Projection(1))
    before = template.anchor.copy()
    template.follow(Projection(2))
    assert not np.allclose(before, template.anchor)
    np.testing.assert_allclose(FeatureTemplate.distances([template], some_patches[None, :1]), 0.0, atol=1e-4)


def test_update_moves_the_mean_and_not_the_anchor(some_patches: np.ndarray):
    """Learning brings a new look nearer; the first look stays at distance zero."""
    template = FeatureTemplate(some_patches[0], Projection(1))
    before = FeatureTemplate.distances([template], some_patches[None])[0]
    for _ in range(20):
        template.update(some_patches[1])
    after = FeatureTemplate.distances([template], some_patches[None])[0]
    assert after[1] < 0.7 * before[1]
    assert after[0] < 1e-4


def test_zero_vectors_stay_zero():
    """A flat window has no direction; scaling it gives no NaN."""
    np.testing.assert_array_equal(unit_rows(np.zeros((2, 3), np.float32)), np.zeros((2, 3)))
