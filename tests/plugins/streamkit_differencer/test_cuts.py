"""Cuts between scenes."""

import numpy as np
import pytest

from streamkit_differencer.cuts import CALM_FRAMES, COVERED_FRAMES, CUT_FRAMES, Cut, CutDetector

SHARE = 0.75
SHAPE = (240, 320)


def scene(seed, shape=SHAPE):
    """An image with shades larger than a mean."""
    coarse = np.random.default_rng(seed).integers(60, 150, (shape[0] // 8 + 1, shape[1] // 8 + 1))
    return np.kron(coarse, np.ones((8, 8)))[: shape[0], : shape[1]].astype(np.uint8)


def judged(*images):
    """What a detector says of images, after a calm stretch of the first one."""
    detector = CutDetector()
    for _ in range(CALM_FRAMES + 1):
        assert detector.update(images[0], SHARE) is Cut.NONE
    return [detector.update(image, SHARE) for image in images]


@pytest.mark.parametrize("shape", [SHAPE, (144, 144), (40, 50)])
def test_another_scene_is_a_cut_after_some_frames(shape):
    """Suspected at once, confirmed when it stays, and once only."""
    verdicts = judged(scene(1, shape), *[scene(2, shape)] * (CUT_FRAMES + 5))
    suspected = [Cut.SUSPECTED] * (CUT_FRAMES - 1)
    assert verdicts == [Cut.NONE, *suspected, Cut.CONFIRMED, *[Cut.NONE] * 5]


def test_a_cut_is_confirmed_while_a_few_tiles_happen_to_look_like_the_old_scene():
    """As many tiles as the threshold asks for change at the cut, and one less two frames later."""
    here, there = scene(1), scene(2)
    there[:60] = here[:60]
    alike = there.copy()
    alike[60:120, :80] = here[60:120, :80]
    assert judged(here, there, there, alike)[1:] == [Cut.SUSPECTED, Cut.SUSPECTED, Cut.CONFIRMED]


def test_a_single_broken_frame_is_no_cut():
    """The known scene follows."""
    assert Cut.CONFIRMED not in judged(scene(1), scene(2), scene(1), scene(3), scene(1))


def test_a_lens_that_is_covered_for_a_moment_is_no_cut():
    """Black frames are suspected for seconds; the scene is known when they end."""
    verdicts = judged(scene(1), *[np.zeros(SHAPE, np.uint8)] * (COVERED_FRAMES - 1), scene(1))
    assert set(verdicts[1:-1]) == {Cut.SUSPECTED}
    assert verdicts[-1] is Cut.NONE


def test_noise_exposure_and_large_movers_are_no_cut():
    """None of them takes the correlation of most tiles away."""
    here, random = scene(1), np.random.default_rng(2)
    noisy = np.clip(here + random.normal(0, 30, SHAPE), 0, 255).astype(np.uint8)
    darker = (0.5 * here + 10).astype(np.uint8)
    covered = here.copy()
    covered[:, :150] = 20
    for image in (noisy, darker, covered):
        assert set(judged(here, *[image] * 5)) == {Cut.NONE}


def test_a_scene_that_always_changes_has_no_cuts():
    """Leaves in the wind close to the lens change every tile; no frame of them begins a calm stretch."""
    detector = CutDetector()
    assert {detector.update(scene(seed), SHARE) for seed in range(40)} == {Cut.NONE}


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (17, 17)])
def test_tiny_images_are_no_error(shape):
    """Their means are fewer."""
    detector, random = CutDetector(), np.random.default_rng(2)
    for _ in range(3):
        assert detector.update(random.integers(0, 255, shape, np.uint8), SHARE) is Cut.NONE
