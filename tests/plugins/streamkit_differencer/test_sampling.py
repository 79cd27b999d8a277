"""Frames on the canvas."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.sampling import draw_on_canvas, without_hidden

SHAPE, CANVAS = (90, 160), (120, 200)
TURNED = translation((22.3, 8.9)) @ np.array([[1.05, 0.06, 0], [-0.06, 1.05, 9], [4e-5, -3e-5, 1]])


def texture(seed=0, shape=SHAPE):
    """A smooth random image."""
    return cv2.GaussianBlur(np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8), (5, 5), 1.2)


def drawn(image, place):
    """The frame on the canvas, the region that it covers, and whether it was resampled."""
    frame = draw_on_canvas(image, place, CANVAS[::-1])
    is_seen = np.zeros(CANVAS, bool)
    for row, (first, last) in enumerate(frame.spans, frame.region[0].start):
        is_seen[row, first:last] = True
    np.testing.assert_array_equal(frame.image > 0, is_seen)
    return frame.image, frame.region, frame.is_resampled


@pytest.mark.parametrize("place", [TURNED, translation((10.25, 7.5))])
def test_frames_are_drawn_as_by_bilinear_interpolation(place):
    """All that is marked as seen has the values of the image, and most of the frame is."""
    frame, region, is_resampled = drawn(texture(), place)
    expected = cv2.warpPerspective(texture(), place, CANVAS[::-1], flags=cv2.INTER_LINEAR).astype(int)
    assert is_resampled
    assert np.count_nonzero(frame) > 0.9 * np.prod(SHAPE)
    assert np.abs(frame - expected)[frame > 0].max() <= 1
    outside = np.ones(CANVAS, bool)
    outside[region] = False
    assert not frame[outside].any()


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.6, 3.0, -2.2])
def test_a_frame_is_drawn_wherever_it_lies(angle):
    """Turned, or partly off the canvas: each seen pixel is of the frame."""
    for x, y in ((100, 60), (10, 20), (190, 110)):
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        place = translation((x, y)) @ turn @ translation((-SHAPE[1] / 2, -SHAPE[0] / 2))
        covered = cv2.warpPerspective(np.full(SHAPE, 255, np.uint8), place, CANVAS[::-1])
        frame, _, _ = drawn(texture() // 4 + np.uint8(100), place)
        assert (covered[frame > 0] == 255).all()
        assert (frame[frame > 0] >= 100).all()


def test_whole_pixels_are_drawn_as_they_are():
    """Without interpolation, and all of them are seen."""
    frame, region, is_resampled = drawn(texture(), translation((20, 12)))
    assert not is_resampled
    assert region == np.s_[12:102, 20:180]
    np.testing.assert_array_equal(frame[region], np.maximum(texture(), 1))
    assert np.count_nonzero(frame) == np.prod(SHAPE)


def test_hidden_pixels_get_the_mean_of_their_surroundings():
    """What is shown stays as it is; a bright graphic on an even ramp leaves no edge."""
    ramp = np.tile(np.linspace(60, 120, SHAPE[1]).astype(np.uint8), (SHAPE[0], 1))
    hidden = np.zeros(SHAPE, np.uint8)
    hidden[30:50, 40:90] = 255
    found = without_hidden(np.where(hidden > 0, hidden, ramp), hidden)
    assert np.array_equal(found[hidden == 0], ramp[hidden == 0])
    assert np.abs(found.astype(int) - ramp).max() <= 6


def test_an_image_that_is_hidden_wholly_is_even():
    """Nothing is shown that could fill it."""
    assert np.ptp(without_hidden(texture(), np.full(SHAPE, 255, np.uint8))) <= 1
