"""Changes of brightness of the whole image."""

import numpy as np
import pytest

from streamkit_differencer.illumination import exposure_change


def texture(seed=0, shape=(120, 160)):
    """An image with contrast and nothing clipped."""
    return np.random.default_rng(seed).integers(60, 150, shape).astype(np.uint8)


def step_between(model, current, known=None):
    """The change of exposure, where everything is known."""
    known = everywhere(model) if known is None else known
    return exposure_change(model.astype(np.float32), current, known)


def everywhere(image):
    """The mask of all pixels."""
    return np.full(image.shape, 255, np.uint8)


@pytest.mark.parametrize(("gain", "offset"), [(1.35, 0.0), (0.6, 0.0), (1.0, 20.0), (0.8, -12.0)])
def test_the_change_is_found_beside_movers(gain, offset):
    """A tenth of the image that changed otherwise does not bend the estimate."""
    model = texture()
    current = np.clip(gain * model + offset + np.random.default_rng(1).normal(0, 2, model.shape), 0, 255)
    current[:12] = 240
    step = step_between(model, current.astype(np.uint8))
    assert step is not None
    assert abs(step[0] - gain) < 0.03
    assert abs(step[0] * 100 + step[1] - gain * 100 - offset) < 2.0


def test_a_small_change_is_left_to_the_background():
    """Less than 4 levels are learnt by equation 3."""
    model = texture()
    assert step_between(model, model + np.uint8(3)) is None


def test_another_scene_is_no_change_of_exposure():
    """No linear change explains another image."""
    assert step_between(texture(1), texture(2) + np.uint8(40)) is None


def test_too_little_is_known():
    """With fewer than 100 sampled pixels nothing is said, nor when all of them are clipped."""
    model = texture()
    known = np.zeros(model.shape, np.uint8)
    assert step_between(model, model + np.uint8(30), known) is None
    black = np.zeros(model.shape, np.uint8)
    assert step_between(model, black) is None


def test_a_picture_without_contrast_has_an_offset():
    """A flat image cannot tell a gain; the offset alone is followed."""
    flat = np.full((120, 160), 100, np.uint8)
    step = step_between(flat, flat + np.uint8(25))
    assert step is not None
    assert step[0] * 100 + step[1] == pytest.approx(125.0)
