"""Shifts too large for optical flow."""

import numpy as np
import pytest

from streamkit.geometry.homography import project
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.settings import ReferenceChoice
from streamkit_stitcher.registration.correlation import search_shift, texture_shift


@pytest.mark.parametrize("step", [(200, 0), (-240, 10), (0, 150)])
def test_the_shift_is_found(aerial_ground, step):
    """The shift is that of the later frame to the earlier one."""
    x, y = 700, 500
    earlier, current = (
        aerial_ground[b : b + 360, a : a + 640] for a, b in ((x, y), (x + step[0], y + step[1]))
    )
    found = search_shift(earlier, current)
    assert found is not None
    assert project(found, np.zeros((1, 2)))[0] == pytest.approx(step, abs=4)


def test_the_most_significant_correlation_of_all_overlaps():
    """Every shift tried one by one; small overlaps do not count."""
    random = np.random.default_rng(3)
    first, second = random.normal(size=(2, 13, 17))
    first[4:12, 2:12] = second[1:9, 6:16]
    found = {}
    for x in range(-17, 17):
        for y in range(-13, 13):
            one = first[max(y, 0) : 13 + min(y, 0), max(x, 0) : 17 + min(x, 0)]
            other = second[max(-y, 0) : 13 + min(-y, 0), max(-x, 0) : 17 + min(-x, 0)]
            if one.size >= 0.15 * first.size:
                correlation = (one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum())
                found[x, y] = correlation * np.sqrt(one.size), correlation
    best = max(found, key=lambda shift: found[shift][0])
    x, y, correlation = texture_shift(first, second)
    assert (x, y) == best == (-4, 3)
    assert correlation == pytest.approx(found[best][1])


def test_shifts_of_a_third_are_registered_without_features(aerial_ground, monkeypatch, make_registrar):
    """Photographs of a survey are measured to a fraction of a pixel without SIFT."""

    def refuse(grey):
        raise AssertionError("features were looked for")

    monkeypatch.setattr("streamkit_stitcher.plane.anchoring.describe", refuse)
    monkeypatch.setattr("streamkit_stitcher.plane.keyframe_content.describe", refuse)
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    places = [(300 + 210 * n, 400) for n in range(4)] + [(930 - 210 * n, 580) for n in range(4)]
    for x, y in places:
        registered = registrar.register(aerial_ground[y : y + 450, x : x + 640])
        assert registered.status is RegistrationStatus.OK
        first = places[0]
        apart = registered.to_reference[:2, 2] - (x - first[0], y - first[1])
        assert np.abs(apart).max() < 0.6
