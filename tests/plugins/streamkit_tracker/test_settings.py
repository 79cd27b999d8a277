"""How many particles and samples a target gets."""

from streamkit_tracker.settings import TrackerSettings


def test_a_detection_needs_fewer_particles():
    """In every layer, by default."""
    seen, unseen = TrackerSettings.seen_layers, TrackerSettings().layers
    assert seen.particles < unseen.particles
    assert seen.size_particles < unseen.size_particles
    assert seen.angle_particles < unseen.angle_particles


def test_a_patch_has_no_more_samples_than_the_target_has_pixels():
    """Large targets get the full patch, those in a crowd the smaller one, tiny ones 16 samples."""
    settings = TrackerSettings()
    assert settings.patch_for(200.0, 0) == 32
    assert settings.patch_for(200.0, 10) == 16
    assert settings.patch_for(12.0, 0) == 16
    assert TrackerSettings(patch=16).patch_for(200.0, 10) == 16
