"""The first look at ground that comes into view."""

import numpy as np

from streamkit_differencer.changes import LONGEST_WAIT
from streamkit_differencer.learning import PROVISIONAL
from streamkit_differencer.noise_learning import set_provisional

SHAPE = (30, 150)
REGION = (2, 28, 5, 143)
INSIDE = np.s_[2:28, 5:143]


def test_unknown_pixels_that_two_frames_show_alike_get_a_first_background():
    """Where both look, nothing is known or has just changed; all else stays."""
    random = np.random.default_rng(0)
    seen, earlier_seen = (np.where(random.random((2, *SHAPE)) < 0.7, 255, 0)).astype(np.uint8)
    valid = random.choice([0, 0, 0, PROVISIONAL, 255], SHAPE).astype(np.uint8)
    valid[10:20] = 255
    waiting = random.choice([LONGEST_WAIT, LONGEST_WAIT - 1, 3], SHAPE).astype(np.uint8)
    earlier = random.integers(0, 256, SHAPE).astype(np.uint8)
    background, deviation = random.uniform(0, 255, (2, *SHAPE)).astype(np.float32)
    thresholds = random.integers(0, 256, SHAPE).astype(np.uint8)
    old, known, was, limits = background.copy(), valid.copy(), deviation.copy(), thresholds.copy()
    set_provisional(
        seen,
        earlier,
        earlier_seen,
        waiting,
        background,
        valid,
        deviation,
        thresholds,
        REGION,
        2.0,
        0.1,
        5.0,
        7,
        60,
    )
    new = np.zeros(SHAPE, bool)
    new[INSIDE] = (((seen & earlier_seen) > 0) & (known == 0) & (waiting < LONGEST_WAIT))[INSIDE]
    assert new.sum() > 200
    np.testing.assert_array_equal(valid, np.where(new, PROVISIONAL, known))
    np.testing.assert_array_equal(background, np.where(new, earlier, old))
    for row, column in np.argwhere(new):
        square = earlier[max(row - 1, 2) : min(row + 2, 28), max(column - 1, 5) : min(column + 2, 143)]
        expected = 2.0 + 0.1 * (int(square.max()) - int(square.min()))
        np.testing.assert_allclose(deviation[row, column], expected, rtol=1e-5)
        assert abs(thresholds[row, column] - min(max(5.0 * expected, 7), 60)) <= 0.51
    np.testing.assert_array_equal(deviation[~new], was[~new])
    np.testing.assert_array_equal(thresholds[~new], limits[~new])
