"""The choice between two values of a pixel."""

import numpy as np

from streamkit_differencer.comparison import Comparison
from streamkit_differencer.ground import KNOWN, PROVISIONAL, UNKNOWN, CanvasFrame, Ground
from streamkit_differencer.learning import Limits, Rates, learn

# Wider than the parts of a row that are skipped as a whole.
SHAPE = (17, 150)
SAME = 7


def learn_frame(state, image, mask, quiet, quiet_frames=4, absorb_frames=10, min_frames=3):
    """Learns from a frame; updates `state`."""
    rounded = np.rint(state["background"]).astype(np.uint8)
    known = {name: values for name, values in state.items() if name != "thresholds"}
    ground = Ground.unknown(SHAPE[::-1])._replace(**known)
    spans = np.full((SHAPE[0], 2), (0, SHAPE[1]))
    frame = CanvasFrame(image, (0, SHAPE[0], 0, SHAPE[1]), spans, is_resampled=True)
    found = Comparison(rounded, state["thresholds"], quiet, mask, follows_exposure=False)
    limits = Limits(quiet_frames, absorb_frames, SAME, min_frames)
    learn(frame, np.zeros_like(image), found, ground, Rates(0.0, 0.0, 0.0), limits)


def a_state(seed, valid):
    """Random images of the model, with few frames counted."""
    random = np.random.default_rng(seed)
    counts = "known_frames", "other_frames"
    whole = {name: random.integers(0, 12, SHAPE).astype(np.uint16) for name in counts}
    whole["other"], whole["valid"] = random.integers(90, 110, SHAPE).astype(np.uint8), valid
    whole["thresholds"] = random.integers(4, 9, SHAPE).astype(np.uint8)
    whole["background"] = random.uniform(0, 255, SHAPE).astype(np.float32)
    return whole


def test_foreground_that_was_seen_as_long_as_the_background_replaces_it():
    """The other value counts up while it rests and down while it does not show; ground keeps its counts."""
    random = np.random.default_rng(1)
    image = random.integers(90, 110, SHAPE).astype(np.uint8)
    quiet, mask, valid = (
        np.where(random.random(SHAPE) < share, 255, 0).astype(np.uint8) for share in (0.7, 0.3, 0.8)
    )
    mask &= valid
    mask[:, 60:130], valid[:, 60:130] = 0, KNOWN
    state = a_state(2, valid)
    old = {name: values.copy() for name, values in state.items()}
    learn_frame(state, image, mask, quiet)
    rests, foreground = quiet > 0, mask > 0
    like = np.abs(image.astype(int) - old["other"]) <= old["thresholds"]
    seen = np.where(like, old["other_frames"] + rests, np.maximum(old["other_frames"].astype(int) - 1, 0))
    begins = foreground & ~like & (seen == 0)
    seen = np.where(foreground, seen, old["other_frames"])
    exchanged = foreground & rests & (like | begins) & (seen >= np.minimum(old["known_frames"], 10))
    other = np.where(begins, image, old["other"])
    new = rests & (old["valid"] == UNKNOWN)
    known = old["known_frames"] + (rests & ~foreground & (old["valid"] == KNOWN))
    wanted = {
        "background": np.where(exchanged | new, image, old["background"]),
        "valid": np.where(new, KNOWN, old["valid"]),
        "known_frames": np.where(exchanged, seen, np.where(new, np.maximum(old["known_frames"], 4), known)),
        "other_frames": np.where(exchanged, old["known_frames"], seen),
        "other": np.where(exchanged, np.rint(old["background"]), other),
    }
    assert exchanged.any()
    for name, values in wanted.items():
        np.testing.assert_array_equal(state[name], values, name)


def test_a_first_look_yields_to_what_is_quiet():
    """Quiet foreground replaces a first look that was seen once; other foreground is not learnt."""
    image, mask = np.full(SHAPE, 200, np.uint8), np.full(SHAPE, 255, np.uint8)
    quiet = np.zeros(SHAPE, np.uint8)
    quiet[:, :10] = 255
    state = a_state(3, np.full(SHAPE, PROVISIONAL, np.uint8))
    state["background"][:], state["known_frames"][:] = 90, 1
    state["other_frames"][:] = 1
    learn_frame(state, image, mask, quiet)
    np.testing.assert_array_equal(state["valid"], np.where(quiet > 0, KNOWN, PROVISIONAL))
    np.testing.assert_array_equal(state["background"], np.where(quiet > 0, 200, 90))


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
    np.testing.assert_allclose(state["background"], 150, atol=2)


def test_a_leaf_at_rest_does_not_replace_ground_that_was_seen_more_often():
    """Four quiet frames of it are fewer than those of the ground, eight are more."""
    state = a_provisional_state(150)
    show(state, [150, 80, 150, 30, 151, 149, 150, 110, 150])
    show(state, [60], quiet=255)
    np.testing.assert_allclose(state["background"], 150, atol=2)
    show(state, [60] * 8, quiet=255)
    np.testing.assert_allclose(state["background"], 60)


def test_a_vehicle_on_new_ground_is_no_background_after_a_few_frames():
    """Under a camera that flies a value must be seen as long as quiet ground."""
    state = a_provisional_state(150)
    show(state, [60] * 11, min_frames=12)
    np.testing.assert_allclose(state["background"], 150)
    show(state, [60], min_frames=12)
    np.testing.assert_allclose(state["background"], 60)
