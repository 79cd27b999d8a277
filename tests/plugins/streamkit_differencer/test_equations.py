"""Equations 1 to 4."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.equations import (
    FrameDifference,
    dynamic_matrix,
    foreground,
    grown,
    logical_matrix,
    update_background,
)
from streamkit_differencer.resampling import BAND
from streamkit_differencer.scratch import Scratch


class SlowReference:
    """The equations pixel by pixel, as section 2.2 of the paper is read."""

    def __init__(self, tau, quiet_frames, ts, tf, alpha):
        self.tau, self.quiet_frames, self.ts, self.tf, self.alpha = tau, quiet_frames, ts, tf, alpha
        self.frames, self.d, self.b, self.s, self.f = [], {}, {}, {}, {}
        self.nearly = set()

    def update(self, frame):
        height, width = frame.shape
        time = len(self.frames)
        for pixel in np.ndindex(height, width):
            value = int(frame[pixel])
            known = pixel in self.b
            self.f[pixel] = int(known and abs(value - self.b[pixel]) > self.tf)
            if known and abs(abs(value - self.b[pixel]) - self.tf) < 1e-3:
                self.nearly.add((time, pixel))
            d = self.d.get(pixel, self.quiet_frames)
            if time >= self.tau:
                changed = abs(value - int(self.frames[-self.tau][pixel])) > self.ts
                self.s[pixel] = int(changed)
                if changed:
                    d = self.quiet_frames
                elif d != 0:
                    d -= 1
            self.d[pixel] = d
            if d == 0:
                before = self.b.get(pixel, float(value))
                self.b[pixel] = self.alpha * value + (1 - self.alpha) * before
        self.frames.append(frame)


@pytest.mark.parametrize("seed", range(3))
def test_the_equations_match_a_slow_per_pixel_reference(seed):
    """D, S and F are exact and B within 1e-3 of the equations evaluated pixel by pixel."""
    random = np.random.default_rng(seed)
    tau, quiet = int(random.integers(1, 4)), int(random.integers(2, 7))
    fast = FrameDifference(tau, quiet, 18.0, 22.0, 0.08)
    slow = SlowReference(tau, quiet, 18.0, 22.0, 0.08)
    scene = random.integers(0, 256, (9, 13))
    earlier = []
    for time in range(40):
        scene = np.where(random.random(scene.shape) < 0.04, random.integers(0, 256, scene.shape), scene)
        frame = np.clip(scene + random.integers(-12, 13, scene.shape), 0, 255).astype(np.uint8)
        mask = fast.update(frame)
        slow.update(frame)
        assert set(np.unique(mask)) <= {0, 255}
        for pixel in np.ndindex(frame.shape):
            # B is float32: where the difference is T_F within B's own precision, either answer is right.
            if (time, pixel) not in slow.nearly:
                assert (mask[pixel] > 0) == slow.f[pixel], (time, pixel)
            assert fast.dynamic[pixel] == slow.d[pixel], (time, pixel)
            assert (fast.valid[pixel] > 0) == (pixel in slow.b), (time, pixel)
            if pixel in slow.b:
                assert abs(fast.background[pixel] - slow.b[pixel]) < 1e-3, (time, pixel)
        if time >= tau:
            logical = logical_matrix(frame, earlier[-tau], 18.0)
            assert all((logical[pixel] > 0) == slow.s[pixel] for pixel in np.ndindex(frame.shape))
        earlier.append(frame)
    assert len(slow.nearly) < 5


def test_equation_1_keeps_a_quiet_pixel_at_zero():
    """The case the paper leaves out: no change and D = 0 stays 0; a change always restarts at lambda."""
    dynamic = np.array([[0, 0, 1, 7]], np.uint8)
    logical = np.array([[0, 255, 0, 255]], np.uint8)
    assert dynamic_matrix(dynamic, logical, 12).tolist() == [[0, 12, 0, 12]]
    assert dynamic_matrix(np.full((1, 4), 255, np.uint8), logical, 255).tolist() == [[254, 255, 254, 255]]


def test_thresholds_must_be_exceeded():
    """A difference equal to the threshold is no change, in equation 2 and in equation 4."""
    base = np.full((3, 3), 100, np.uint8)
    assert not logical_matrix(base + np.uint8(18), base, 18.0).any()
    assert logical_matrix(base - np.uint8(19), base, 18.0).all()
    assert not foreground(base + np.uint8(22), base.astype(np.float32), 22.0).any()
    assert foreground(base + np.uint8(22), base.astype(np.float32) - 0.01, 22.0).all()


def test_equation_3_learns_differences_smaller_than_a_level():
    """A background in float32 follows a step of 4 levels at alpha 0.05, which 8 bits would never do."""
    background = np.full((2, 2), 100.0, np.float32)
    current = np.full((2, 2), 104, np.uint8)
    everywhere = np.full((2, 2), 255, np.uint8)
    for _ in range(200):
        update_background(background, current, everywhere, 0.05)
    np.testing.assert_allclose(background, 104.0, atol=0.01)


def test_equation_3_leaves_other_pixels_alone():
    """Only pixels of the mask are updated."""
    background = np.zeros((1, 2), np.float32)
    update_background(background, np.full((1, 2), 200, np.uint8), np.array([[255, 0]], np.uint8), 0.5)
    assert background.tolist() == [[100.0, 0.0]]


def test_a_pixel_that_was_never_quiet_is_never_foreground():
    """There is no background before the first lambda quiet frames, so no ghost of the first frame."""
    difference = FrameDifference(interval=1, quiet_frames=5)
    for time in range(30):
        flicker = np.full((4, 4), 0 if time % 2 else 200, np.uint8)
        assert not difference.update(flicker).any()
    assert not difference.valid.any()


@pytest.mark.parametrize("tolerance", [1, 2])
def test_tolerance_bears_an_error_of_registration(tolerance):
    """An edge that is off by the tolerance is not foreground; by one pixel more it is."""
    background = np.zeros((20, 40), np.float32)
    background[:, 20:] = 200.0
    within, beyond = np.zeros((2, 20, 40), np.uint8)
    within[:, 20 + tolerance :] = beyond[:, 21 + tolerance :] = 200
    assert not foreground(within, background, 22.0, tolerance=tolerance).any()
    assert foreground(beyond, background, 22.0, tolerance=tolerance).any()
    assert foreground(within, background, 22.0).any()


def test_gradient_gain_raises_the_threshold_at_edges_only():
    """Near an edge of 100 levels a gain of 0.5 bears 50 levels more, elsewhere nothing more."""
    earlier = np.zeros((10, 40), np.uint8)
    earlier[:, 20:] = 100
    current = earlier + np.uint8(40)
    changed = logical_matrix(current, earlier, 18.0, gradient_gain=0.5) > 0
    assert not changed[:, 19:21].any()
    assert changed[:, :18].all()
    assert changed[:, 22:].all()


def test_weak_differences_count_beside_strong_ones():
    """A grey part that touches a bright one is foreground with it; one that stands alone is not."""
    background = np.full((40, 60), 100, np.uint8)
    current = background.copy()
    current[10:16, 10:16], current[10:16, 16:20] = 200, 107
    current[30:36, 40:46] = 107
    strong = foreground(current, background, 12.0)
    mask, _ = grown(strong, current, background, 12.0, 0.5)
    assert mask[11:15, 11:19].all()
    assert not mask[25:].any()
    each, _ = grown(strong, current, background, np.full(background.shape, 12, np.uint8), 0.5)
    np.testing.assert_array_equal(mask, each)
    known = np.full(background.shape, 255, np.uint8)
    known[:, 18:] = 0
    within, _ = grown(strong, current, background, 12.0, 0.5, known=known)
    np.testing.assert_array_equal(within, mask & known)


@pytest.mark.parametrize("seed", range(4))
def test_growth_by_parts_is_growth_of_the_whole(seed):
    """Bands of the picture that are looked at one by one give what all of it at once would."""
    random = np.random.default_rng(seed)
    shape = 2 * BAND + 31, 90
    background = np.full(shape, 100, np.uint8)
    current = background + cv2.blur(random.integers(0, 60, shape).astype(np.uint8), (3, 3))
    mask = cv2.dilate(np.where(random.random(shape) < 0.004, 255, 0).astype(np.uint8), np.ones((4, 4)))
    weak = np.where(current - background > 6, 255, 0).astype(np.uint8)
    expected = cv2.medianBlur(mask, 3)
    for _ in range(2):
        expected |= cv2.dilate(expected, np.ones((5, 5), np.uint8)) & weak
    found, where = grown(mask, current, background, 12.0, 0.5)
    np.testing.assert_array_equal(found, expected)
    covered = np.zeros(shape, int)
    for part in where:
        covered[part] += 1
    assert covered.max() == 1
    assert covered[found > 0].all()


def test_planes_that_are_used_again_change_nothing():
    """With scratch planes of another picture the masks are those of fresh ones."""
    random, scratch = np.random.default_rng(7), Scratch()
    for shape in ((40, 60), (31, 70), (40, 60)):
        first, second = random.integers(0, 256, (2, *shape), np.uint8)
        dynamic, each = random.integers(0, 12, shape, np.uint8), random.integers(5, 90, shape, np.uint8)
        for arguments in ({"scratch": scratch}, {}):
            results = [
                logical_matrix(first, second, 18.0, gradient_gain=0.3, **arguments).copy(),
                dynamic_matrix(dynamic, first, 12, **arguments).copy(),
                foreground(first, second, each, tolerance=1, gradient_gain=0.2, **arguments).copy(),
                grown(first, first, second, each, 0.5, **arguments)[0].copy(),
            ]
            if arguments:
                reused = results
        for one, other in zip(reused, results, strict=True):
            np.testing.assert_array_equal(one, other)
