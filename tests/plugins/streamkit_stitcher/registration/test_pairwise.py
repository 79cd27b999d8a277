"""Registration of a frame to the one before."""

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, translation
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.pairwise import (
    WorkingImage,
    register,
    thumbnail_correlation,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid

LIMITS = FitLimits()


def work(frame):
    """A frame at working size 640."""
    level = working_level(frame.shape, 640)
    return WorkingImage(pyramid((frame,), level + 1)[level], 2**level, 220)


def test_pairs_with_moving_cars_are_registered_to_a_fraction_of_a_pixel(ground, make_flight):
    """Median corner error at most 0.2 px at 720p, 90 % at most 0.35 px, none lost, with 6 cars in view."""
    flight = make_flight(ground, 200, cars=6, noise=3.0)
    errors = []
    for index in range(1, 200, 14):
        motion = register(work(flight.frame(index - 1)), work(flight.frame(index)), IDENTITY, LIMITS)
        assert motion.model is MotionModel.HOMOGRAPHY
        errors.append(flight.error(motion.matrix, index, index - 1))
    assert np.median(errors) <= 0.2
    assert np.percentile(errors, 90) <= 0.35


def test_a_step_of_the_gain_is_no_cut(ground, make_flight):
    """A frame 1.35 times as bright is registered after its exposure was matched."""
    flight = make_flight(ground, 200, cars=0)
    brighter = np.clip(flight.frame(1) * 1.35, 0, 255).astype(np.uint8)
    motion = register(work(flight.frame(0)), work(brighter), IDENTITY, LIMITS)
    assert motion.model is MotionModel.HOMOGRAPHY
    assert flight.error(motion.matrix, 1) < 1.0


def test_another_scene_is_a_cut(ground):
    """Few inliers and unlike thumbnails together tell a cut."""
    assert register(work(ground[:720, :1280]), work(ground[720:1440, 700:1980]), IDENTITY, LIMITS).is_cut


def test_a_jump_is_found_by_cross_correlation(ground):
    """A shift beyond the reach of the pyramid is recovered, not taken for a cut."""
    shift = np.array([250.0, 60.0])
    earlier, current = ground[300:1020, 300:1580], ground[360:1080, 550:1830]
    motion = register(work(earlier), work(current), IDENTITY, FitLimits(max_step=0.4))
    assert not motion.is_cut
    assert motion.model is not None
    assert motion.matrix[:2, 2] == pytest.approx(shift, abs=3.0)


def test_a_guess_carries_the_search(ground):
    """With the motion roughly known, even a jump is followed at once."""
    earlier, current = ground[300:1020, 300:1580], ground[300:1020, 580:1860]
    motion = register(
        work(earlier), work(current), translation(np.array([285.0, 4.0])), FitLimits(max_step=0.4)
    )
    assert motion.model is MotionModel.HOMOGRAPHY
    assert motion.matrix[:2, 2] == pytest.approx([280.0, 0.0], abs=0.3)


def test_flat_frames_are_not_registered():
    """Nothing to follow gives no motion, the identity and no exception."""
    flat = np.full((720, 1280), 90, np.uint8)
    motion = register(work(flat), work(flat), IDENTITY, LIMITS)
    assert motion.model is None
    assert np.array_equal(motion.matrix, IDENTITY)
    assert work(flat).is_blank


def test_thumbnails_tell_scenes_apart(ground):
    """The same ground correlates above 0.95 under its motion, other ground below 0.5."""
    here, shifted = work(ground[:720, :1280]), work(ground[:720, 80:1360])
    there = work(ground[720:1440, 700:1980])
    assert thumbnail_correlation(here, shifted, translation(np.array([80.0, 0.0]))) > 0.95
    assert thumbnail_correlation(here, there, IDENTITY) < 0.5


@pytest.mark.parametrize("deviation", [10.0, 40.0, 120.0])
@pytest.mark.parametrize("shape", [(360, 640), (720, 1280)])
def test_noise_is_nothing_to_register(ground, deviation, shape):
    """A receiver's noise has many corners and is blank; ground under much noise is not."""
    random = np.random.default_rng(4)
    noise = np.clip(random.normal(128, deviation, shape), 0, 255).astype(np.uint8)
    assert work(noise).is_blank
    height, width = shape
    view = ground[:height, :width] + random.normal(0, 25, shape)
    assert not work(np.clip(view, 0, 255).astype(np.uint8)).is_blank


@pytest.mark.parametrize(
    ("shape", "level"),
    [((720, 1280), 1), ((1080, 1920), 2), ((360, 640), 0), ((1, 5000), 0), ((100, 5000), 0)],
)
def test_frames_are_halved_to_the_working_width(shape, level):
    """1280 px become 640 and 1920 px 480; a strip is not halved away."""
    assert working_level(shape, 640) == level
