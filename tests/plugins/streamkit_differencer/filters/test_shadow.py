"""Shadows distinguished from objects."""

import numpy as np

from streamkit_differencer.filters.shadow import shadow_mask


def street():
    """Textured ground, 60 by 90, with noise."""
    random = np.random.default_rng(0)
    return np.repeat(np.repeat(random.uniform(90, 160, (20, 30)), 3, axis=0), 3, axis=1).astype(np.uint8)


def seen(ground, factor_area, thing_area):
    """The ground with a shadow of factor 0.6 and an object of its own texture."""
    random = np.random.default_rng(1)
    frame = ground.astype(np.float32)
    frame[factor_area] *= 0.6
    frame[thing_area] = random.uniform(20, 240, frame[thing_area].shape)
    return np.clip(frame + random.normal(0, 1.5, frame.shape), 0, 255).astype(np.uint8)


def test_a_things_shadow_goes_and_the_thing_stays():
    """Most of the shadow is found, and hardly anything of the object."""
    shadow, thing = np.s_[20:32, 40:60], np.s_[20:40, 20:40]
    ground, mask = street(), np.zeros((60, 90), np.uint8)
    mask[shadow] = mask[thing] = 255
    found = shadow_mask(seen(ground, shadow, thing), ground, mask)
    assert (found[shadow] > 0).mean() > 0.8
    assert (found[thing] > 0).mean() < 0.1
    assert not (found & ~mask).any()


def test_a_dark_thing_all_by_itself_is_no_shadow():
    """What would vanish whole is a dark vehicle."""
    ground = np.full((60, 90), 120.0, np.float32)
    frame, mask = ground.astype(np.uint8), np.zeros((60, 90), np.uint8)
    frame[20:30, 20:50], mask[20:30, 20:50] = 70, 255
    assert not shadow_mask(frame, ground, mask).any()


def test_without_foreground_there_is_no_shadow():
    """Nothing in, nothing out."""
    ground = street()
    assert not shadow_mask(ground.astype(np.uint8), ground, np.zeros((60, 90), np.uint8)).any()
