"""Changes of brightness of the whole image."""

import numpy as np
import pytest

from streamkit_differencer.illumination import exposure_change


def texture(seed=0, shape=(120, 160)):
    """An image with contrast and nothing clipped."""
    return np.random.default_rng(seed).integers(60, 150, shape).astype(np.uint8)


def everywhere(image):
    """The mask of all pixels."""
    return np.full(image.shape, 255, np.uint8)


@pytest.mark.parametrize(("gain", "offset"), [(1.35, 0.0), (0.6, 0.0), (1.0, 20.0), (0.8, -12.0)])
def test_the_change_is_found_beside_movers(gain, offset):
    """A tenth of the image that changed otherwise does not bend the estimate."""
    model = texture()
    current = np.clip(gain * model + offset + np.random.default_rng(1).normal(0, 2, model.shape), 0, 255)
    current[:12] = 240
    step = exposure_change(model.astype(np.float32), current.astype(np.uint8), everywhere(model))
    assert step is not None
    assert abs(step[0] - gain) < 0.03
    assert abs(step[0] * 100 + step[1] - gain * 100 - offset) < 2.0


def test_a_small_change_is_left_to_the_background():
    """Less than 4 levels are learnt by equation 3."""
    model = texture()
    assert exposure_change(model, model + np.uint8(3), everywhere(model)) is None


def test_another_scene_is_no_change_of_exposure():
    """No linear change explains another image."""
    assert exposure_change(texture(1), texture(2) + np.uint8(40), everywhere(texture())) is None


def test_too_little_is_known():
    """With fewer than 100 sampled pixels nothing is said, nor when all of them are clipped."""
    model = texture()
    known = np.zeros(model.shape, np.uint8)
    assert exposure_change(model, model + np.uint8(30), known) is None
    black = np.zeros(model.shape, np.uint8)
    assert exposure_change(model, black, everywhere(model)) is None


def test_a_picture_without_contrast_has_an_offset():
    """A flat image cannot tell a gain; the offset alone is followed."""
    flat = np.full((120, 160), 100, np.uint8)
    step = exposure_change(flat, flat + np.uint8(25), everywhere(flat))
    assert step is not None
    assert step[0] * 100 + step[1] == pytest.approx(125.0)
