"""What a frame teaches."""

import numpy as np

from streamkit_differencer.learning import AVERAGED, NEW, NONE, PROVISIONAL, REPLACED, learn
from streamkit_differencer.noise_learning import begin_noise
from tests.plugins.streamkit_differencer.paper_equations import update_background

SHAPE = (21, 34)
REGION = (2, 19, 3, 30)
INSIDE = np.s_[2:19, 3:30]
SAME = 7


def masks(seed, *shares):
    """Random masks."""
    random = np.random.default_rng(seed)
    return [np.where(random.random(SHAPE) < share, 255, 0).astype(np.uint8) for share in shares]


def learn_frame(state, image, mask, quiet, quiet_frames=4, absorb_frames=10, fewest=3):
    """Learns from a frame; updates `state`, and gives the updates and the number of new pixels."""
    updates = np.full(SHAPE, 77, np.uint8)
    rounded = np.rint(state["background"]).astype(np.uint8)
    images = image, mask, quiet, state["background"], rounded, state["thresholds"], state["valid"]
    counts = state["known_frames"], state["other"], state["other_frames"]
    return updates, learn(*images, *counts, updates, REGION, 0.08, quiet_frames, absorb_frames, SAME, fewest)


def a_state(seed, valid):
    """Random images of the model, with few frames counted."""
    random = np.random.default_rng(seed)
    counts = "known_frames", "other_frames"
    whole = {name: random.integers(0, 12, SHAPE).astype(np.uint8) for name in counts}
    whole["other"], whole["valid"] = random.integers(90, 110, SHAPE).astype(np.uint8), valid
    whole["thresholds"] = random.integers(4, 9, SHAPE).astype(np.uint8)
    whole["background"] = random.uniform(0, 255, SHAPE).astype(np.float32)
    return whole


def test_each_pixel_learns_as_it_should():
    """Ground by equation 3, what is new at once, what was seen as long as the background, all else not."""
    image = np.random.default_rng(0).integers(90, 110, SHAPE).astype(np.uint8)
    quiet, mask, valid = masks(1, 0.7, 0.3, 0.8)
    mask &= valid
    state = a_state(2, valid)
    old = {name: values.copy() for name, values in state.items()}
    updates, count = learn_frame(state, image, mask, quiet)
    rests, foreground = quiet > 0, mask > 0
    like = np.abs(image.astype(int) - old["other"]) <= old["thresholds"]
    seen = np.where(like, old["other_frames"] + rests, np.maximum(old["other_frames"].astype(int) - 1, 0))
    begins = foreground & ~like & (seen == 0)
    seen = np.where(foreground, seen, old["other_frames"])
    exchanged = foreground & rests & (like | begins) & (seen >= np.minimum(old["known_frames"], 10))
    new, averaged = rests & (old["valid"] == 0), rests & ~foreground & (old["valid"] > 0)
    expected = np.full(SHAPE, NONE)
    expected[averaged], expected[new], expected[exchanged] = AVERAGED, NEW, REPLACED
    other = np.where(begins, image, old["other"])
    wanted = {
        "valid": np.where(new, 255, old["valid"]),
        "known_frames": np.where(exchanged, seen, np.where(new, 4, old["known_frames"] + averaged)),
        "other_frames": np.where(exchanged, old["known_frames"], seen),
        "other": np.where(exchanged, np.rint(old["background"]), other),
        "thresholds": old["thresholds"],
    }
    assert exchanged[INSIDE].any()
    assert count == np.count_nonzero(new[INSIDE])
    np.testing.assert_array_equal(updates[INSIDE], expected[INSIDE])
    for name, values in wanted.items():
        np.testing.assert_array_equal(state[name][INSIDE], values[INSIDE], name)
    taught = old["background"].copy()
    update_background(taught, image, averaged.astype(np.uint8), 0.08)
    taught[expected >= REPLACED] = image[expected >= REPLACED]
    np.testing.assert_allclose(state["background"][INSIDE], taught[INSIDE], atol=1e-4)
    for name, values in state.items():
        values[INSIDE] = old[name][INSIDE]
        np.testing.assert_array_equal(values, old[name], name)


def test_what_was_looked_at_but_once_is_learnt_as_soon_as_it_is_quiet():
    """A first look is no background that foreground is kept from."""
    image, mask = np.full(SHAPE, 200, np.uint8), np.full(SHAPE, 255, np.uint8)
    quiet = np.zeros(SHAPE, np.uint8)
    quiet[:, :10] = 255
    state = a_state(3, np.full(SHAPE, PROVISIONAL, np.uint8))
    state["background"][:], state["known_frames"][:] = 90, 1
    _, count = learn_frame(state, image, mask, quiet)
    learns = (quiet > 0)[INSIDE]
    assert count == learns.sum()
    np.testing.assert_array_equal(state["valid"][INSIDE], np.where(learns, 255, PROVISIONAL))
    np.testing.assert_array_equal(state["background"][INSIDE], np.where(learns, 200, 90))


def show(state, values, quiet=0, **limits):
    """Shows a provisional background one value per frame."""
    for value in values:
        image = np.full(SHAPE, value, np.uint8)
        difference = np.abs(image - np.rint(state["background"])) > state["thresholds"]
        mask = np.where(difference, 255, 0).astype(np.uint8)
        learn_frame(state, image, mask, np.full(SHAPE, quiet, np.uint8), **limits)


def a_provisional_state(value):
    """A first look at `value`, with the noise of an edge."""
    state = a_state(4, np.full(SHAPE, PROVISIONAL, np.uint8))
    for name in ("known_frames", "other_frames"):
        state[name][:] = 0
    state["background"][:], state["thresholds"][:] = value, 20
    return state


def test_ground_seen_between_leaves_replaces_the_leaf_of_the_first_look():
    """Leaves show many values, the ground behind them one; neither is ever quiet."""
    state = a_provisional_state(60)
    show(state, [150, 151, 90, 149, 40, 150, 110, 151, 150])
    np.testing.assert_allclose(state["background"][INSIDE], 150, atol=2)
    assert (state["valid"] == PROVISIONAL).all()


def test_a_leaf_at_rest_does_not_replace_ground_that_was_seen_more_often():
    """Four quiet frames of it are fewer than those of the ground, eight are more."""
    state = a_provisional_state(150)
    show(state, [150, 80, 150, 30, 151, 149, 150, 110, 150])
    show(state, [60], quiet=255)
    np.testing.assert_allclose(state["background"][INSIDE], 150, atol=2)
    show(state, [60] * 8, quiet=255)
    np.testing.assert_allclose(state["background"][INSIDE], 60)


def test_a_vehicle_on_new_ground_is_no_background_after_a_few_frames():
    """Under a camera that flies a value must be seen as long as quiet ground."""
    state = a_provisional_state(150)
    show(state, [60] * 11, fewest=12)
    np.testing.assert_allclose(state["background"][INSIDE], 150)
    show(state, [60], fewest=12)
    np.testing.assert_allclose(state["background"][INSIDE], 60)


def test_new_pixels_begin_with_the_noise_that_edges_may_have():
    """The first deviation and a share of the local range, and the threshold of that; others keep theirs."""
    earlier, updates = np.full(SHAPE, 100, np.uint8), np.full(SHAPE, AVERAGED, np.uint8)
    earlier[:, 20:] = 150
    updates[5:9] = NEW
    deviation, thresholds = np.full(SHAPE, 3.0, np.float32), np.full(SHAPE, 12, np.uint8)
    begin_noise(earlier, updates, deviation, thresholds, REGION, 2.0, 0.1, 4.0, 9, 25)
    np.testing.assert_allclose(deviation[5:9, 3:19], 2.0)
    np.testing.assert_allclose(deviation[5:9, 19:21], 7.0)
    assert (thresholds[5:9, 3:19] == 9).all()
    assert (thresholds[5:9, 19:21] == 25).all()
    deviation[5:9, 3:30], thresholds[5:9, 3:30] = 3.0, 12
    assert (deviation == 3.0).all()
    assert (thresholds == 12).all()
