"""How many particles and samples a target gets."""

from streamkit_tracker.settings import TrackerSettings


def test_a_detection_needs_fewer_particles():
    """Undetected the full number, with a detection the fewest."""
    settings = TrackerSettings()
    assert settings.layers_for(False, 1.0) == settings.layers
    assert settings.layers_for(True, 1.0) == settings.seen_layers


def test_a_patch_has_no_more_samples_than_the_target_has_pixels():
    """Large targets get the full patch, those in a crowd the smaller one, tiny ones 16 samples."""
    settings = TrackerSettings()
    assert settings.patch_for(200.0, 0) == 32
    assert settings.patch_for(200.0, 10) == 16
    assert settings.patch_for(12.0, 0) == 16
    assert TrackerSettings(patch=16).patch_for(200.0, 10) == 16
