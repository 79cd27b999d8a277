"""How many particles and samples a target gets."""

from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.update.layered_filter import LayerSettings


def test_a_crowd_and_a_detection_need_fewer_particles():
    """Alone and undetected: the full number; in a crowd half of it; with a detection the fewest."""
    settings = TrackerSettings(layers=LayerSettings(particles=220))
    assert settings.layers_for(False, 1).particles == 220
    assert settings.layers_for(False, 20).particles == 110
    assert settings.layers_for(True, 1) == settings.seen_layers


def test_a_patch_has_no_more_samples_than_the_target_has_pixels():
    """Large targets get the full patch, those in a crowd the smaller one, tiny ones 16 samples."""
    settings = TrackerSettings()
    assert settings.patch_for(200.0, 0) == 32
    assert settings.patch_for(200.0, 10) == 16
    assert settings.patch_for(12.0, 0) == 16
    assert TrackerSettings(patch=16).patch_for(200.0, 10) == 16
