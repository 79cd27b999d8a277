"""Eigen templates."""

import numpy as np

from streamkit_tracker.appearance.eigen_template import EigenSettings, EigenTemplate, normalise
from streamkit_tracker.appearance.template_comparison import find_residuals


def patches(count: int, pixels: int = 144, seed: int = 0) -> np.ndarray:
    """Independent noise patches."""
    return (30 * np.random.default_rng(seed).standard_normal((count, pixels))).astype(np.float32)


def eigen_distances(templates: list[EigenTemplate], patches: np.ndarray) -> np.ndarray:
    """Distances float64[t, n] of patches float32[t, n, p], several for each template."""
    result = np.empty(patches.shape[:2])
    for template, some, distances in zip(templates, patches, result, strict=True):
        products, powers = some @ template.rows.T, np.vecdot(some, some)
        moments, pixels = np.empty((3, len(some))), some.shape[1]
        find_residuals(products, powers, *template.constants, pixels, moments, distances)
    return result


def test_the_first_patch_is_at_distance_zero_whatever_the_light():
    """Brightness and contrast do not count."""
    first = patches(1)[0]
    template = EigenTemplate(first)
    distances = eigen_distances([template], np.stack([first, 0.5 * first + 20, 1.7 * first - 9])[None])[0]
    np.testing.assert_allclose(distances, 0.0, atol=1e-4)


def test_unrelated_patches_are_at_distance_two():
    """Uncorrelated unit patches differ by 1 + 1."""
    template = EigenTemplate(patches(1)[0])
    distances = eigen_distances([template], patches(200, seed=1)[None])[0]
    assert abs(float(distances.mean()) - 2.0) < 0.1


def test_folded_normalisation_equals_the_plain_formula():
    """The product with [basis, mean, 1] gives the residual of normalised patches."""
    template = EigenTemplate(patches(1)[0], EigenSettings(eigenvectors=4, batch=3))
    for patch in patches(9, seed=2):
        template.update(patch)
    others = patches(5, seed=3)
    centred = normalise(others) - template.mean
    basis = template.rows[:4].T
    plain = ((centred**2).sum(axis=1) - ((centred @ basis) ** 2).sum(axis=1)) / others.shape[1]
    np.testing.assert_allclose(eigen_distances([template], others[None])[0], plain, rtol=1e-3)


def test_several_templates_answer_as_each_alone():
    """A batch over targets changes nothing."""
    templates = [EigenTemplate(patch) for patch in patches(3)]
    others = patches(6, seed=4).reshape(3, 2, -1)
    alone = [eigen_distances([t], o[None])[0] for t, o in zip(templates, others, strict=True)]
    np.testing.assert_allclose(eigen_distances(templates, others), alone, rtol=1e-4)


def test_the_basis_is_that_of_batch_pca():
    """Without forgetting the incremental basis spans what a decomposition of all patches at once spans."""
    generator = np.random.default_rng(5)
    hidden = generator.standard_normal((3, 100))
    samples = (generator.standard_normal((60, 3)) * [30, 20, 10]) @ hidden + generator.standard_normal(
        (60, 100)
    )
    template = EigenTemplate(
        samples[0].astype(np.float32), EigenSettings(eigenvectors=8, batch=10, forgetting=1.0)
    )
    for sample in samples.astype(np.float32):
        template.update(sample)
    normal = normalise(samples.astype(np.float32))
    with_anchor = np.vstack(
        [normal[:1], *[np.vstack([normal[i : i + 10], normal[:1]]) for i in range(0, 60, 10)]]
    )
    _, _, exact = np.linalg.svd(with_anchor - with_anchor.mean(axis=0), full_matrices=False)
    overlap = np.linalg.svd(exact[:3] @ template.basis[:3].T, compute_uv=False)
    assert np.degrees(np.arccos(np.clip(overlap, 0, 1))).max() < 5.0


def test_the_template_learns_a_new_look_and_keeps_the_first():
    """After learning, both the first patch and the new one are near."""
    first, second = patches(2)
    template = EigenTemplate(first)
    for _ in range(40):
        template.update(second)
    distances = eigen_distances([template], np.stack([first, second])[None])[0]
    assert distances[1] < 0.1
    assert distances[0] < 0.8


def test_a_flat_patch_has_no_texture_and_gives_finite_distances():
    """Constant patches neither divide by zero nor look like a target."""
    flat = np.full(64, 12.0, np.float32)
    template = EigenTemplate(flat)
    assert not template.textured
    assert np.isfinite(eigen_distances([template], np.stack([flat, patches(1, 64)[0]])[None])).all()
