"""Equations 1 to 4."""

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from streamkit_differencer import equations
from streamkit_differencer.equations import MAX_WAIT


def changed(image, earlier, threshold):
    """Equation 2."""
    mask = np.empty_like(image)
    for row in range(len(image)):
        equations.find_changes(image[row], earlier[row], np.uint8(threshold), mask[row])
    return mask


def count_down(waiting, mask):
    """Equation 1."""
    for row in range(len(waiting)):
        equations.count_down(waiting[row], mask[row])


def quiet_mask(waiting, quiet_frames):
    """The pixels with D = 0."""
    mask = np.empty_like(waiting)
    for row in range(len(waiting)):
        equations.find_quiet(waiting[row], quiet_frames, mask[row])
    return mask


def update_background(background, image, mask, rate):
    """Equation 3."""
    for row in range(len(image)):
        equations.update_background(background[row], image[row], mask[row], np.float32(rate))


def foreground(image, background, threshold):
    """Equation 4 with one threshold."""
    mask, thresholds = np.empty_like(image), np.full_like(image, int(threshold))
    for row in range(len(image)):
        equations.find_foreground_pixels(image[row], background[row], thresholds[row], mask[row])
    return mask


@dataclass
class FrameDifference:
    """Equations 1 to 4 for a camera that does not move, and nothing else."""

    interval: int = 3
    quiet_frames: int = 12
    ts: float = 18.0
    tf: float = 22.0
    alpha: float = 0.08
    waiting: np.ndarray | None = None
    background: np.ndarray | None = None
    valid: np.ndarray | None = None
    earlier: list[np.ndarray] = field(default_factory=list)

    def update(self, current):
        if self.waiting is None:
            self.waiting = np.full(current.shape, MAX_WAIT, np.uint8)
            self.background, self.valid = (
                np.zeros(current.shape, np.float32),
                np.zeros(current.shape, np.uint8),
            )
        mask = foreground(current, cv2.convertScaleAbs(self.background), self.tf) & self.valid
        if len(self.earlier) == self.interval:
            count_down(self.waiting, changed(current, self.earlier.pop(0), self.ts))
        quiet = quiet_mask(self.waiting, self.quiet_frames)
        cv2.copyTo(current.astype(np.float32), quiet & ~self.valid, self.background)
        update_background(self.background, current, quiet, self.alpha)
        self.valid |= quiet
        self.earlier.append(current.copy())
        return mask

    @property
    def dynamic(self):
        """D(t)."""
        least = MAX_WAIT - self.quiet_frames
        return np.maximum(self.waiting, least) - least


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
            self.f[pixel] = int(known and abs(value - round(self.b[pixel])) > self.tf)
            if known and abs(self.b[pixel] % 1 - 0.5) < 1e-3:
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
            # B is float32: halfway between two levels within its own precision, either rounding is right.
            if (time, pixel) not in slow.nearly:
                assert (mask[pixel] > 0) == slow.f[pixel], (time, pixel)
            assert fast.dynamic[pixel] == slow.d[pixel], (time, pixel)
            assert (fast.valid[pixel] > 0) == (pixel in slow.b), (time, pixel)
            if pixel in slow.b:
                assert abs(fast.background[pixel] - slow.b[pixel]) < 1e-3, (time, pixel)
        if time >= tau:
            logical = changed(frame, earlier[-tau], 18.0)
            assert all((logical[pixel] > 0) == slow.s[pixel] for pixel in np.ndindex(frame.shape))
        earlier.append(frame)
    assert len(slow.nearly) < 5


def test_equation_1_keeps_a_quiet_pixel_quiet():
    """The case the paper leaves out: no change and D = 0 stays 0; a change always restarts at lambda."""
    waiting = np.array([[0, 243, 244, 250]], np.uint8)
    assert quiet_mask(waiting, 12).tolist() == [[255, 255, 0, 0]]
    count_down(waiting, np.array([[0, 255, 0, 255]], np.uint8))
    assert quiet_mask(waiting, 12).tolist() == [[255, 0, 255, 0]]
    assert waiting.tolist() == [[0, 255, 243, 255]]


def test_thresholds_must_be_exceeded():
    """A difference equal to the threshold is no change, in equation 2 and in equation 4."""
    base = np.full((3, 3), 100, np.uint8)
    assert not changed(base + np.uint8(18), base, 18.0).any()
    assert changed(base - np.uint8(19), base, 18.0).all()
    assert not foreground(base + np.uint8(22), base, 22).any()
    assert foreground(base - np.uint8(23), base, 22).all()


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
