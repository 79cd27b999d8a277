"""What the filters see, and the histogram of colours."""

import numpy as np
import pytest

from streamkit_tracker.appearance.region_features import GRID, ColourHistogram, RegionFeatures
from streamkit_tracker.appearance.window_sampling import WindowSampler

WINDOW = np.array([120.0, 90, 40, 30, 0.0])


def sampler_of(shift: tuple[int, int] = (0, 0), red: int = 200, light: float = 1.0) -> WindowSampler:
    """A red target upon a green ground of the same grey level."""
    levels = 128 + 6 * np.random.default_rng(0).standard_normal((180, 240))
    u, v = np.full((90, 120), 90, np.uint8), np.full((90, 120), 90, np.uint8)
    row, column = 90 + shift[1] - 15, 120 + shift[0] - 20
    v[row // 2 : row // 2 + 15, column // 2 : column // 2 + 20] = red
    sampler = WindowSampler()
    sampler.set_frame((light * levels).astype(np.uint8), (u, v))
    return sampler


@pytest.mark.parametrize("shift", [(0, 0), (24, -10), (-16, 20)])
def test_a_target_is_found_by_its_colour_alone(shift: tuple[int, int]):
    """The likeliest place is where it went, within a cell and a half."""
    first = sampler_of()
    features = RegionFeatures(first, WINDOW)
    histogram = ColourHistogram(features.read(first, WINDOW), features.extent)
    region = features.read(sampler_of(shift), WINDOW)
    likely = histogram.respond(region)
    row, column = np.unravel_index(int(likely.argmax()), likely.shape)
    place = (np.array([column, row]) - GRID / 2) * region.side / GRID
    np.testing.assert_allclose(place, shift, atol=1.5 * region.side / GRID)
    assert likely.max() > 0.9


def test_a_new_colour_is_learnt():
    """After some frames the colour that the target has now distinguishes it from its ground."""
    first, other = sampler_of(), sampler_of(red=30)
    features = RegionFeatures(first, WINDOW)
    histogram = ColourHistogram(features.read(first, WINDOW), features.extent)
    region = features.read(other, WINDOW)
    for _ in range(80):
        histogram.learn(region, 1.0)
    likely = histogram.respond(region)
    assert likely[GRID // 2, GRID // 2] > 0.9
    assert likely[2, 2] < 0.2


def test_a_grey_frame_has_no_hue():
    """Without chroma planes the channels are those of grey pixels, and the same as with neutral planes."""
    levels = np.random.default_rng(0).integers(0, 255, (180, 240)).astype(np.uint8)
    neutral = np.full((90, 120), 128, np.uint8)
    spectra = []
    for chroma in (None, (neutral, neutral)):
        sampler = WindowSampler()
        sampler.set_frame(levels, chroma)
        spectra.append(RegionFeatures(sampler, WINDOW).read(sampler, WINDOW).spectra)
    np.testing.assert_array_equal(spectra[0], spectra[1])


def test_a_small_target_is_read_with_more_ground():
    """The region has a fifteenth of the frame's side at least: 64 px at 1280x720."""
    sampler = WindowSampler()
    sampler.set_frame(np.full((720, 1280), 128, np.uint8))
    tiny = np.array([120.0, 90, 10, 10, 0])
    assert RegionFeatures(sampler, tiny).read(sampler, tiny).side == pytest.approx(64.0)
    assert RegionFeatures(sampler, WINDOW).read(sampler, WINDOW).side == pytest.approx(4 * np.sqrt(1200))


def extent_in_frame(factor: float, side: float) -> np.ndarray:
    """Of a square target in the middle of a flat frame, 1280x720 times a factor."""
    rows, columns = int(720 * factor), int(1280 * factor)
    sampler = WindowSampler()
    sampler.set_frame(np.full((rows, columns), 128, np.uint8))
    return RegionFeatures(sampler, np.array([columns / 2, rows / 2, side, side, 0.0])).extent


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("side", [12.0, 40.0], ids=["small", "large"])
def test_a_frame_of_another_size_shows_the_same_region(factor: float, side: float):
    """What moves by as many sides of the target is found as well."""
    np.testing.assert_allclose(extent_in_frame(factor, factor * side), extent_in_frame(1.0, side))


def test_the_smallest_targets_keep_five_cells():
    """A larger region would leave too little of them to be distinguished from their ground."""
    assert (extent_in_frame(1.0, 4.0) * GRID >= 5.0).all()
