"""The keyframes of a plane."""

import threading

import numpy as np
import pytest

from streamkit.geometry.homography import IDENTITY, normalised, translation
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.settings import PlaneSettings

STEP = 100.0


def shift(pixels):
    """The homography of a shift along x."""
    return translation(np.array([pixels, 0.0]))


@pytest.fixture
def keyframes(ground):
    """Four keyframes 100 px apart, tied exactly, of which the last was put down 3 px off."""
    keyframes = KeyframeMap(PlaneSettings())
    columns, rows = np.meshgrid(np.arange(150, 500, 50), np.arange(50, 320, 50))
    points = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    for index, error in enumerate((0.0, 0.0, 0.0, 3.0)):
        left = round(index * STEP)
        images = (ground[400:760, left : left + 640],)
        patches = np.arange(len(points))
        ties = [Tie(index - 1, 0, patches, points, points - (STEP, 0.0))] if index else []
        keyframes.add(images, shift(left + error), 0, ties)
    yield keyframes
    keyframes.close()


def test_finishing_moves_keyframes_to_where_their_ties_agree(keyframes):
    """A keyframe 3 px off is corrected, and the residual vanishes."""
    assert keyframes.finish() == pytest.approx(0.0, abs=1e-3)
    assert keyframes.homographies[3] == pytest.approx(shift(3 * STEP), abs=1e-2)
    assert np.array_equal(keyframes.homographies[0], IDENTITY)


def test_an_adjustment_reports_the_change_of_the_active_keyframe(keyframes):
    """The adopted change maps the active keyframe's old homography to the new one."""
    before = keyframes.active.to_reference
    keyframes.begin_adjustment()
    change = keyframes.adopt()
    assert keyframes.adopt() is None
    assert normalised(change @ before) == pytest.approx(keyframes.active.to_reference, abs=1e-9)
    assert keyframes.active.to_reference == pytest.approx(shift(3 * STEP), abs=1e-2)


def test_rebasing_puts_a_keyframe_at_the_origin_and_all_others_with_it(keyframes):
    """The chosen keyframe has the identity; relations stay; stored keyframes follow."""
    change = keyframes.rebase(1, 1)
    assert change == pytest.approx(shift(-STEP))
    assert keyframes.homographies[1] == pytest.approx(IDENTITY)
    assert keyframes.homographies[2] == pytest.approx(shift(STEP))
    assert keyframes.stored[2].to_reference == pytest.approx(shift(STEP))
    assert keyframes.active.to_reference == pytest.approx(keyframes.homographies[3])


def test_no_thread_is_left_when_closed(keyframes):
    """Closing waits for an adjustment that runs."""
    keyframes.begin_adjustment()
    keyframes.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("adjuster")]
