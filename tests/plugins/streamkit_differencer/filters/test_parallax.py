"""Tall objects under a moving camera."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.filters.components import components_of
from streamkit_differencer.filters.parallax import find_parallax
from streamkit_differencer.foreground import find_foreground
from streamkit_differencer.ground import CanvasFrame, Ground
from streamkit_differencer.settings import BackgroundSettings

SHAPE = (120, 160)
EVERYWHERE = np.full(SHAPE, 255, np.uint8)


def view(x, width=40, tone=220):
    """Textured ground with a bright object whose left edge is at x."""
    ground = np.random.default_rng(2).integers(70, 110, (30, 40)).astype(np.uint8)
    picture = cv2.resize(ground, (160, 120), interpolation=cv2.INTER_LINEAR)
    picture[40:70, x : x + width] = tone
    return picture


def slides_in(now, before, learnt, known=EVERYWHERE):
    """The foreground, its blocks, and which of them shift."""
    ground = Ground.unknown((160, 120))
    ground.background[:], ground.valid[:] = learnt, known
    frame = CanvasFrame(now, (0, 120, 0, 160), np.full((120, 2), (0, 160)), is_resampled=True)
    settings = BackgroundSettings(
        foreground_threshold=12.0, noise_gain=0.0, tolerance=1, hysteresis_ratio=1.0
    )
    _, thresholds, mask = find_foreground(frame, ground, settings)
    assert mask.any()
    blocks, count = components_of(mask)
    images = (now, learnt, known, before, thresholds)
    shifts = np.full((len(blocks), 2), (2.0, 0.0))
    return mask, blocks, find_parallax(images, mask, blocks, count, [shifts])


def judged(now, before, learnt, known=EVERYWHERE):
    """The share of the foreground that slides, of images now, of tau before and in the background."""
    _, _, slides = slides_in(now, before, learnt, known)
    return slides.mean()


@pytest.mark.parametrize("tone", [220, 4])
def test_a_roof_that_slides_against_the_camera_is_left_out(tone):
    """By two pixels in tau frames, and by eight since its ground was learnt: both of its edges go.

    Also those of one that is darker than its threshold.
    """
    assert judged(*(view(left, tone=tone) for left in (60, 62, 68))) > 0.95


@pytest.mark.parametrize(
    ("now", "before", "learnt", "share"),
    [(68, 66, 60, 0.05), (60, 70, 90, 0.3), (60, 69, 68, 0.05)],
    ids=["along-the-camera", "faster-than-tall", "learnt-by-mistake"],
)
def test_what_does_not_slide_like_that_stays(now, before, learnt, share):
    """An object that goes the camera's way, one that is too fast, and one whose old place was learnt.

    Of the fast one what is next to its learnt place may go.
    """
    assert judged(view(now), view(before), view(learnt)) < share


def test_a_thing_that_is_new_stays():
    """Nothing of it is in the background."""
    assert judged(view(60), view(62), view(60, width=0)) < 0.05


def test_each_piece_is_judged_by_itself():
    """A roof goes, a car that has just come stays."""
    now, before, learnt = view(60), view(62), view(66)
    now[90:100, 20:40] = 230
    _, blocks, slides = slides_in(now, before, learnt)
    gone = blocks[slides, 0]
    assert gone.size
    assert gone.max() < 72


def test_the_edge_of_a_roof_goes_although_a_car_drives_along_it():
    """Both are one component of the foreground; what is near both may stay."""
    now, before, learnt = view(60), view(62), view(68)
    now[70:90, 56:76] = 20
    mask, blocks, slides = slides_in(now, before, learnt)
    assert cv2.connectedComponents(mask)[0] < 4
    is_car = (blocks[:, 0] >= 70) & (blocks[:, 0] < 90)
    assert not slides[is_car].any()
    assert slides[blocks[:, 0] < 64].all()
