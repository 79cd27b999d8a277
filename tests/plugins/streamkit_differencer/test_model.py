"""The background model on its canvas."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.ground import DEVIATION_STEPS, PROVISIONAL, CanvasFrame
from streamkit_differencer.model import BackgroundModel
from streamkit_differencer.noise import EDGE_SHARE, FIRST_DEVIATION, RESTLESS_RATE
from streamkit_differencer.settings import BackgroundSettings

SHAPE = (120, 160)
WHOLE = np.s_[0:120, 0:160]
SEEN = np.full(SHAPE, 255, np.uint8)
SETTINGS = BackgroundSettings(frame_interval=2, quiet_frames=4, absorb_frames=10)
# A new model compares with its first frame; ground that comes into view later, with tau frames before.
FIRST_VALID = 1 + SETTINGS.quiet_frames


def ground(seed=0):
    """An image of smooth shades."""
    coarse = np.random.default_rng(seed).uniform(70, 140, (12, 16)).astype(np.float32)
    return cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_LINEAR).astype(np.uint8)


def with_thing(image, x, y=20, size=10, tone=250):
    """The image with a square in it."""
    changed = image.copy()
    changed[y : y + size, x : x + size] = tone
    return changed


def show(model, image, seen=SEEN, region=WHOLE):
    """Gives a model a frame: its foreground, 128 where that is quiet, and if it follows the exposure."""
    canvas, (rows, columns) = np.zeros(SHAPE, np.uint8), region
    bounds = rows.start, rows.stop, columns.start, columns.stop
    canvas[region] = np.minimum(image, seen)
    spans = np.full((rows.stop - rows.start, 2), (columns.start, columns.stop))
    found = model.update(CanvasFrame(canvas, bounds, spans, is_resampled=True))
    return found.mask, found.follows_exposure


def learnt(settings=SETTINGS, image=None, frames=FIRST_VALID + 2):
    """A model that knows the ground."""
    model = BackgroundModel((160, 120), settings)
    for _ in range(frames):
        show(model, ground() if image is None else image)
    return model


def test_background_is_valid_after_lambda_quiet_frames():
    """A frame to compare with and lambda frames without change, and not one less; provisional before."""
    model = BackgroundModel((160, 120), SETTINGS)
    for time in range(FIRST_VALID):
        assert not (model.ground.valid == 255).any(), time
        show(model, ground())
    assert (model.ground.valid == 255).all()
    np.testing.assert_array_equal(model.ground.background, ground())


def test_new_ground_begins_with_the_noise_that_edges_may_have():
    """A first deviation and a share of the local range; a still frame takes a part of both."""
    image = np.full(SHAPE, 100, np.uint8)
    image[:, 80:] = 150
    model = learnt(image=image, frames=1)
    # Most pixels stay the same, but no run of them does.
    show(model, image + (np.arange(160) % 8 == 0).astype(np.uint8))
    deviation = model.ground.deviation / DEVIATION_STEPS
    kept, step = 1 - RESTLESS_RATE, 1 / DEVIATION_STEPS
    still = np.flatnonzero(np.arange(79) % 8)
    np.testing.assert_allclose(deviation[:, still], kept * FIRST_DEVIATION, atol=step)
    np.testing.assert_allclose(deviation[:, 79], kept * (FIRST_DEVIATION + 50 * EDGE_SHARE), atol=step)


def test_blocks_that_a_codec_repeats_teach_no_noise():
    """What it codes anew after a while, a few grey levels off at edges, is no foreground; a pale thing is."""
    random = np.random.default_rng(0)
    image = cv2.GaussianBlur(random.integers(0, 256, SHAPE, np.uint8), (0, 0), 1.2)
    model = learnt(image=image, frames=40)
    again = np.clip(np.rint(image + random.uniform(-9.0, 9.0, SHAPE)), 0, 255).astype(np.uint8)
    mask, _ = show(model, again)
    assert np.count_nonzero(mask) < 0.01 * mask.size
    pale = image[20:40, 30:50] + np.uint8(40)
    again[20:40, 30:50] = pale
    mask, _ = show(model, again)
    assert np.count_nonzero(mask[20:40, 30:50]) > 0.9 * pale.size


def test_a_thing_is_foreground_and_marked_as_changed():
    """Foreground is 255 while it changed within lambda frames, then 128."""
    model = learnt()
    image = with_thing(ground(), 30)
    marks = []
    for _ in range(SETTINGS.quiet_frames + SETTINGS.frame_interval + 2):
        mask, event = show(model, image)
        assert not event
        marks.append(int(mask[25, 35]))
        assert not mask[:18].any()
    assert marks[0] == 255
    assert marks[-1] == 128


def test_a_thing_that_stays_becomes_background_after_absorb_frames():
    """Equation 3 alone would take it in after lambda frames."""
    model = learnt(frames=FIRST_VALID + SETTINGS.absorb_frames)
    image = with_thing(ground(), 30)
    frames = 0
    while show(model, image)[0].any():
        frames += 1
        assert frames < 100
    assert frames == SETTINGS.frame_interval + SETTINGS.quiet_frames - 1 + SETTINGS.absorb_frames


def test_background_under_a_thing_is_kept():
    """An object that stops for a while and goes on leaves no ghost."""
    model = learnt()
    for _ in range(8):
        show(model, with_thing(ground(), 30))
    mask, _ = show(model, ground())
    assert not mask.any()


def test_a_ghost_lasts_as_long_as_the_object_was_seen():
    """What the first frames show by chance yields to what is seen for longer, before absorb frames."""
    model = learnt(SETTINGS, with_thing(ground(), 30), FIRST_VALID)
    frames = 0
    while show(model, ground())[0].any():
        frames += 1
        assert frames < 100
    times = SETTINGS.frame_interval, SETTINGS.quiet_frames
    assert frames == sum(times) - 1 + SETTINGS.quiet_frames


def test_an_object_that_stopped_for_long_leaves_no_ghost_when_it_goes():
    """The ground under it is remembered, and is background again as soon as it is quiet."""
    model = learnt(SETTINGS, frames=40)
    for _ in range(3 * SETTINGS.absorb_frames):
        mask, _ = show(model, with_thing(ground(), 30))
    assert not mask.any()
    frames = 0
    while show(model, ground())[0].any():
        frames += 1
        assert frames < 100
    assert frames == SETTINGS.frame_interval + SETTINGS.quiet_frames


@pytest.mark.parametrize("absorb_frames", [20, 300])
def test_an_object_that_stopped_is_foreground_for_as_long_as_is_set(absorb_frames):
    """Where the ground was known for longer; not for a frame more, also beyond what a byte counts."""
    model = learnt(replace(SETTINGS, absorb_frames=absorb_frames), frames=absorb_frames + 20)
    frames = 0
    while show(model, with_thing(ground(), 30))[0].any():
        frames += 1
        assert frames < 400
    times = SETTINGS.frame_interval, SETTINGS.quiet_frames
    assert frames == absorb_frames + sum(times) - 1


def test_what_the_frame_does_not_cover_is_held():
    """Outside `seen` and outside the region nothing changes, and nothing there is foreground."""
    model = learnt()
    arrays = model.ground.background, model.ground.valid, model.ground.deviation, model.ground.other_frames
    before = [np.copy(array) for array in arrays]
    seen = np.zeros((30, 40), np.uint8)
    seen[:, 20:] = 255
    image = ground()[10:40, 5:45]
    image[10:20] = 250
    mask, _ = show(model, image, seen, np.s_[10:40, 5:45])
    assert mask[12:18, 22:].all()
    assert not mask[:, :20].any()
    for array, old in zip(
        (model.ground.background, model.ground.valid, model.ground.deviation, model.ground.other_frames),
        before,
        strict=True,
    ):
        outside = np.ones(SHAPE, bool)
        outside[10:40, 25:45] = False
        np.testing.assert_array_equal(array[outside], old[outside])


def test_ground_that_comes_into_view_has_no_background_yet():
    """Pixels not seen tau frames ago are not quiet, whatever they show; soon a first look stands for it."""
    model = BackgroundModel((160, 120), SETTINGS)
    left = np.zeros(SHAPE, np.uint8)
    left[:, :80] = 255
    for _ in range(20):
        show(model, ground(), left, WHOLE)
    for time in range(SETTINGS.frame_interval + SETTINGS.quiet_frames):
        assert not (model.ground.valid[:, 80:] == 255).any()
        has_looked = (model.ground.valid[:, 80:] == PROVISIONAL).any()
        assert has_looked or time <= SETTINGS.frame_interval + 1
        assert not has_looked or time > SETTINGS.frame_interval
        mask, _ = show(model, ground())
        assert not mask.any()
    assert (model.ground.valid == 255).all()


def test_a_thing_that_drives_onto_new_ground_is_found_before_that_is_known():
    """It is detected from the first look, and is not learnt as ground while it drives."""
    model = BackgroundModel((160, 120), SETTINGS)
    left = np.zeros(SHAPE, np.uint8)
    left[:, :80] = 255
    for _ in range(20):
        show(model, ground(), left, WHOLE)
    for _ in range(SETTINGS.frame_interval + 2):
        show(model, ground())
    for x in (100, 104):
        mask, _ = show(model, with_thing(ground(), x))
        assert not (model.ground.valid[20:30, x : x + 10] == 255).any()
        assert (mask[20:30, x : x + 10] == 255).mean() > 0.9
        mask[18:32, 98 : x + 12] = 0
        assert not mask.any()


def test_a_busy_road_is_no_new_ground():
    """Two frames that differ are no background; only at the edge of what changes they may be alike."""
    model = BackgroundModel((160, 120), SETTINGS)
    for time in range(30):
        image = with_thing(ground(), 40, size=40, tone=(10, 200, 250)[time % 3])
        mask, _ = show(model, image)
        assert not mask[22:58, 42:78].any()
    assert not model.ground.valid[22:58, 42:78].any()
    assert (model.ground.valid[70:] == 255).all()


def test_a_model_that_begins_has_a_provisional_background():
    """A thing that comes into view before the ground was quiet is found."""
    model = BackgroundModel((160, 120), SETTINGS)
    for _ in range(SETTINGS.frame_interval + 1):
        show(model, ground())
    mask, _ = show(model, with_thing(ground(), 30))
    assert (mask[20:30, 30:40] == 255).mean() > 0.9
    mask[18:32, 28:42] = 0
    assert not mask.any()


@pytest.mark.parametrize("gain", [1.35, 0.7])
def test_a_step_of_exposure_is_followed(gain):
    """The model takes the new brightness over: the object stays foreground, the ground does not become it."""
    model = learnt()
    brighter = np.clip(gain * with_thing(ground(), 30, tone=10).astype(float), 0, 255).astype(np.uint8)
    mask, event = show(model, brighter)
    assert event
    assert (mask[20:30, 30:40] > 0).mean() > 0.9
    mask[18:32, 28:42] = 0
    assert not mask.any()


def test_exposure_that_creeps_is_followed():
    """Two levels per frame, faster than equation 3 learns, give no foreground."""
    model = learnt()
    for step in range(30):
        mask, _ = show(model, ground() + np.uint8(2 * step))
        assert not mask.any(), step


def test_noise_over_the_whole_picture_is_no_other_scene():
    """Nearly all pixels change and their means do not: the background is kept."""
    model, random = learnt(), np.random.default_rng(3)
    for _ in range(4):
        noisy = np.clip(ground() + random.normal(0, 60, SHAPE), 0, 255).astype(np.uint8)
        _, event = show(model, noisy)
        assert not event
    assert not show(model, ground())[0].any()


def test_a_scrolled_model_goes_on_as_if_nothing_happened():
    """The same images on the scrolled canvas give the same foreground."""
    here, there = learnt(), learnt()
    there.move(translation((6, -4)), is_scroll=True)
    image = with_thing(ground(), 30)
    expected, _ = show(here, image)
    found, _ = show(there, image[10:50, 10:60], 255, np.s_[6:46, 16:66])
    np.testing.assert_array_equal(found, expected[10:50, 10:60])


def test_warping_by_a_shift_equals_scrolling():
    """Resampling at whole pixels keeps values, but for the border of what is known."""
    scrolled_model, warped_model = learnt(), learnt()
    scrolled_model.move(translation((6, -4)), is_scroll=True)
    warped_model.move(translation((6, -4)), is_scroll=False)
    known = warped_model.ground.valid > 0
    assert known.mean() > 0.8
    assert (scrolled_model.ground.valid[known] > 0).all()
    np.testing.assert_allclose(
        warped_model.ground.background[known], scrolled_model.ground.background[known], atol=1e-3
    )


def test_counters_do_not_wrap():
    """Ground that was seen for as long as is counted, then 300 frames of a standing object."""
    model = learnt(BackgroundSettings(frame_interval=1, quiet_frames=4, absorb_frames=255))
    model.ground.known_frames[:] = 65530
    for _ in range(10):
        show(model, ground())
    assert (model.ground.known_frames == 65535).all()
    image = with_thing(ground(), 30)
    masks = [int(show(model, image)[0][25, 35]) for _ in range(300)]
    assert np.count_nonzero(masks) == 1 + 4 - 1 + 255
    assert model.ground.other_frames[25, 35] == 255
