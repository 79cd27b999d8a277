"""What a frame teaches."""

import numpy as np

from streamkit_differencer.learning import AVERAGED, NEW, NONE, REPLACED, learn
from streamkit_differencer.noise_learning import PROVISIONAL, begin_noise
from tests.plugins.streamkit_differencer.paper_equations import update_background

SHAPE = (21, 34)
REGION = (2, 19, 3, 30)
INSIDE = np.s_[2:19, 3:30]


def masks(seed, *shares):
    """Random masks."""
    random = np.random.default_rng(seed)
    return [np.where(random.random(SHAPE) < share, 255, 0).astype(np.uint8) for share in shares]


def test_each_pixel_learns_as_it_should():
    """Ground by equation 3, what stands for long and what is new at once, all else not at all."""
    random = np.random.default_rng(0)
    quiet, mask, valid = masks(1, 0.7, 0.3, 0.8)
    mask &= valid
    standing, image = (
        random.integers(5, 12, SHAPE).astype(np.uint8),
        random.integers(0, 256, SHAPE).astype(np.uint8),
    )
    background = random.uniform(0, 255, SHAPE).astype(np.float32)
    old, known, stood = background.copy(), valid.copy(), standing.copy()
    updates = np.full(SHAPE, 77, np.uint8)
    count = learn(image, mask, quiet, background, valid, standing, updates, REGION, 0.08, 10)
    still, counts = (quiet & mask) > 0, np.where(mask > 0, stood, 0) + ((quiet & mask) > 0)
    new = (quiet > 0) & (mask == 0) & (known == 0)
    slowly = ((quiet > 0) & (mask == 0) & (known > 0)).astype(np.uint8)
    expected = np.full(SHAPE, NONE)
    expected[slowly > 0], expected[new], expected[still & (counts >= 10)] = AVERAGED, NEW, REPLACED
    np.testing.assert_array_equal(updates[INSIDE], expected[INSIDE])
    np.testing.assert_array_equal(standing[INSIDE], counts[INSIDE])
    np.testing.assert_array_equal(valid[INSIDE] > 0, ((known > 0) | new)[INSIDE])
    assert count == np.count_nonzero(new[INSIDE])
    taught = old.copy()
    update_background(taught, image, slowly, 0.08)
    taught[expected >= REPLACED] = image[expected >= REPLACED]
    np.testing.assert_allclose(background[INSIDE], taught[INSIDE], atol=1e-4)
    for array, before in ((background, old), (valid, known), (standing, stood)):
        array[INSIDE] = before[INSIDE]
        np.testing.assert_array_equal(array, before)


def test_what_was_looked_at_but_once_is_learnt_as_soon_as_it_is_quiet():
    """A first look is no background that foreground is kept from."""
    image = np.full(SHAPE, 200, np.uint8)
    valid, quiet = np.full(SHAPE, PROVISIONAL, np.uint8), np.zeros(SHAPE, np.uint8)
    quiet[:, :10] = 255
    background, updates = np.full(SHAPE, 90, np.float32), np.zeros(SHAPE, np.uint8)
    mask, standing = np.full(SHAPE, 255, np.uint8), np.zeros(SHAPE, np.uint8)
    count = learn(image, mask, quiet, background, valid, standing, updates, REGION, 0.08, 10)
    learns = (quiet > 0)[INSIDE]
    assert count == learns.sum()
    np.testing.assert_array_equal(valid[INSIDE], np.where(learns, 255, PROVISIONAL))
    np.testing.assert_array_equal(background[INSIDE], np.where(learns, 200, 90))


def test_counts_of_frames_end_at_what_a_byte_holds():
    """An object that stands for 255 frames has stood for 255."""
    mask, standing = np.full(SHAPE, 255, np.uint8), np.full(SHAPE, 254, np.uint8)
    for _ in range(3):
        learn(
            mask,
            mask,
            mask,
            np.zeros(SHAPE, np.float32),
            mask.copy(),
            standing,
            mask.copy(),
            REGION,
            0.1,
            255,
        )
    assert (standing[INSIDE] == 255).all()


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
