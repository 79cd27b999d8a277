"""Where the filter is asked, and what the particles are told."""

import math

import numpy as np
import pytest

from streamkit_tracker.correlation_filter import Response
from streamkit_tracker.discrimination import changed_windows, response_prior, search_places

WINDOW = np.array([100.0, 80, 40, 10, 0.3])


def test_a_seen_target_is_asked_for_at_three_sizes():
    """The same place and aspect; the middle size first."""
    places = search_places(WINDOW, 0)
    np.testing.assert_array_equal(places[0], WINDOW)
    np.testing.assert_array_equal(places[:, [0, 1, 4]], np.repeat(WINDOW[None, [0, 1, 4]], 3, axis=0))
    np.testing.assert_allclose(places[:, 2] / places[:, 3], 4.0)
    assert places[1, 2] > WINDOW[2] > places[2, 2]


def test_the_search_grows_with_the_gap_up_to_a_limit():
    """Rings around the prediction, three in turn; the widest grows, never beyond three sides."""
    reaches = [np.hypot(*(search_places(WINDOW, n)[1:, :2] - WINDOW[:2]).T) for n in (3, 9, 999, 1000, 1001)]
    for ring in reaches:
        np.testing.assert_allclose(ring, ring[0])
    assert reaches[0][0] < reaches[1][0] < reaches[2][0]
    assert [ring[0] for ring in reaches[2:]] == pytest.approx([60, 40, 20])


def test_the_softer_the_target_the_more_the_filter_counts():
    """A rigid target is free to turn; a soft one is held to the filter's size and the drawn angle."""
    response = Response((101.0, 79.0), (40.0, 10.0), 0.3, 0.7, 20.0)
    rigid, soft = response_prior(response, 1.0, 0.3), response_prior(response, 9.0, 0.3)
    assert rigid.heading_std == math.inf
    assert soft.heading_std < 0.1
    assert soft.sides_std == pytest.approx(rigid.sides_std / 3)
    assert soft.centroid_std == pytest.approx(rigid.centroid_std / 3)
    assert rigid.centroid == soft.centroid == (101.0, 79.0)


def test_a_target_found_again_may_have_turned_and_resized():
    """Windows about the response: itself first, then smaller, larger and turned both ways; one aspect."""
    response = Response((101.0, 79.0), (40.0, 10.0), 0.3, 0.7, 20.0)
    windows = changed_windows(response)
    np.testing.assert_allclose(windows[0], [101, 79, 40, 10, 0.3])
    np.testing.assert_allclose(windows[:, 2] / windows[:, 3], 4.0)
    assert windows[:, 2].min() < 40 < windows[:, 2].max()
    assert windows[:, 4].min() < 0.3 < windows[:, 4].max()
