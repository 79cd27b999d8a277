"""The layered particle filter against known peaks."""

import numpy as np

from streamkit_tracker.update.layered_filter import (
    SEARCH,
    LayerSettings,
    SearchRows,
    layered_step,
    resample,
)

PEAK = np.array([52.0, 47.0, 22.0, 11.0, 0.5])
SCALES = np.array([1.0, 1.0, 0.8, 0.4, 0.05])


def peak_score(windows: np.ndarray) -> np.ndarray:
    """Log of a Gaussian around PEAK."""
    return np.asarray(-0.5 * np.sum(((windows - PEAK) / SCALES) ** 2, axis=2))


def proposal(windows: np.ndarray, displacement: tuple[float, float] = (0.0, 0.0)) -> SearchRows:
    """Expectations without seeds."""
    searches = np.zeros(len(windows), SEARCH)
    searches["window"], searches["displacement"] = windows, displacement
    searches["spread"], searches["wide_spread"], searches["seed_std"] = 2.0, 5.0, np.inf
    return searches


def run(steps: int, seeds: list[int], start: np.ndarray) -> np.ndarray:
    """Windows float64[t, 5] after some steps, one target for each seed."""
    generators = [np.random.default_rng(seed) for seed in seeds]
    particles, windows = [None] * len(seeds), np.repeat(start[None], len(seeds), axis=0)
    for _ in range(steps):
        estimates = layered_step(particles, generators, proposal(windows), peak_score, LayerSettings())
        particles, windows = estimates.particles, estimates.windows
    return windows


def test_it_climbs_to_the_peak():
    """From 5 px, 10 % and 0.1 rad away it reaches the peak of the score."""
    windows = run(15, [0, 1, 2], PEAK * [1, 1, 1.1, 1.1, 1] + [4, -3, 0, 0, 0.1])
    assert np.hypot(*(windows[:, :2] - PEAK[:2]).T).max() < 0.6
    assert np.abs(windows[:, 4] - PEAK[4]).max() < 0.03
    np.testing.assert_allclose(windows[:, 2:4], np.repeat(PEAK[None, 2:4], 3, axis=0), rtol=0.06)


def test_targets_in_a_batch_are_independent():
    """A target's estimate is the same alone and beside others: its generator is its own."""
    start = PEAK + np.array([3.0, 2, 0, 0, 0])
    np.testing.assert_array_equal(run(4, [5], start)[0], run(4, [1, 5, 9], start)[1])


def test_an_even_score_keeps_the_estimate_near_the_prediction():
    """With no information the weights stay even and the estimate stays near the moved window."""
    start = PEAK.copy()
    flat = layered_step(
        [None],
        [np.random.default_rng(0)],
        proposal(start[None], (3.0, 0.0)),
        lambda windows: np.zeros(windows.shape[:2]),
        LayerSettings(),
    )
    assert flat.contrasts[0] == 0.0
    assert abs(1 / np.sum(flat.particles[0].weights ** 2) - LayerSettings().keep) < 1e-9
    assert np.hypot(*(flat.windows[0, :2] - start[:2] - [3.0, 0.0])) < 3.0


def test_the_angle_is_averaged_modulo_pi():
    """Survivors on both sides of the wrap at pi/2 average to pi/2, not to 0."""
    start = PEAK.copy()
    start[4] = np.pi / 2 - 0.01

    def score(windows: np.ndarray) -> np.ndarray:
        return np.zeros(windows.shape[:2])

    settings = LayerSettings(std_angle=0.05)
    result = layered_step([None], [np.random.default_rng(1)], proposal(start[None]), score, settings)
    assert abs(abs(result.windows[0, 4]) - np.pi / 2) < 0.1


def test_layers_without_particles_are_left_out():
    """Zero size and angle particles leave size and angle alone."""
    start = PEAK + np.array([2.0, 1, 0, 0, 0])
    settings = LayerSettings(particles=50, keep=5, size_particles=0, angle_particles=0)
    result = layered_step([None], [np.random.default_rng(0)], proposal(start[None]), peak_score, settings)
    np.testing.assert_allclose(result.windows[0, 2:], start[2:])


def test_systematic_resampling_draws_by_weight():
    """Each index is drawn as often as its weight says, to within one, and weight 0 never."""
    weights = np.array([0.5, 0.0, 0.3, 0.2, 0.0])
    chosen = np.empty(100, np.intp)
    resample(weights, 0.999, chosen)
    drawn = np.bincount(chosen, minlength=5)
    assert drawn[1] == drawn[4] == 0
    np.testing.assert_allclose(drawn, 100 * weights, atol=1)
