"""Particles follow the time there is."""

import itertools

import numpy as np
import pytest

from streamkit_tracker.budget import Budget
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker


def test_late_frames_halve_the_particles_down_to_an_eighth():
    """Each frame over the budget halves them; some are always left."""
    budget = Budget(0.010)
    shares = []
    for _ in range(5):
        budget.spent(0.020)
        shares.append(budget.share)
    assert shares == [0.5, 0.25, 0.125, 0.125, 0.125]


def test_particles_come_back_after_calm_frames():
    """Ten frames with room for twice as many double them; one frame without room begins the count again."""
    budget = Budget(0.010)
    budget.spent(0.020)
    for spent in [0.001] * 9 + [0.008] + [0.001] * 9:
        budget.spent(spent)
    assert budget.share == 0.5
    budget.spent(0.001)
    assert budget.share == 1.0


@pytest.mark.parametrize(("budget_ms", "share"), [(0.0, 1.0), (10.0, 0.5)])
def test_without_a_budget_time_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, budget_ms: float, share: float
):
    """The same tracks however slow the machine: here each frame takes a thousand seconds."""
    clock = itertools.count(0.0, 1000.0)
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    tracker = MultiTargetTracker(TrackerSettings(budget_ms=budget_ms))
    tracker.step(np.zeros((48, 64), np.uint8), Observation(0.04))
    assert tracker._budget.share == share


def test_shares_scale_every_layer():
    """Half of all three layers, and never none."""
    settings = TrackerSettings()
    half = settings.layers.reduced(0.5)
    assert (half.particles, half.size_particles, half.angle_particles) == (110, 3, 3)
    least = settings.seen_layers.reduced(0.125)
    assert (least.particles, least.size_particles, least.angle_particles) == (8, 1, 1)
