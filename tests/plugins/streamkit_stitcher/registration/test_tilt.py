"""How much a camera tilts: what is learned from its motions, and what that says of a prediction."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.registration.dense_level import STEP_RATIOS, DenseLevel
from streamkit_stitcher.registration.tilt import TiltRatio, motion_prior, tilt_of

PRECISE = np.full(4, 1e-4)
MOTION = translation(np.array([20.0, 0.0]))
LOOSE = np.diag((8.0 * STEP_RATIOS) ** 2)


@pytest.fixture
def level(ground):
    """A keyframe of 320 x 180 px."""
    return DenseLevel(np.ascontiguousarray(ground[300:480, 300:620]))


def tilted(level, perspective):
    """`MOTION` with a perspective in x, px at the middle of a side."""
    return MOTION @ level.matrix_of(np.array([0, 0, 0, 0, 0, 0, perspective, 0.0]))


def learned(level, tilt, variances, frames=30):
    """The deviations of shear and perspective at `MOTION` after so many frames, px, float64[4]."""
    ratio = TiltRatio()
    for frame in range(frames):
        ratio.learn(level, MOTION, tilt if frame % 2 else -tilt, variances)
    return np.sqrt(ratio.variances(level, MOTION))


def test_a_similarity_has_no_tilt(level):
    """However it turns and zooms; a perspective is measured in px."""
    cos, sin = 1.2 * np.cos(0.7), 1.2 * np.sin(0.7)
    turned = np.array([[cos, -sin, 30.0], [sin, cos, -12.0], [0, 0, 1]])
    assert tilt_of(level, turned) == pytest.approx(np.zeros(4), abs=1e-9)
    assert tilt_of(level, tilted(level, 1.5)) == pytest.approx([0, 0, 1.5, 0], abs=1e-9)


def test_the_tilt_of_a_camera_is_learned(level):
    """Perspective of 3 px to and fro under a motion of 20 px; the shear, which is 0, is another matter."""
    shear, _, perspective, _ = learned(level, np.array([0.0, 0, 3, 3]), PRECISE)
    assert perspective == pytest.approx(3.0, rel=0.2)
    assert shear < 0.3


def test_the_perspective_of_a_camera_that_turns_to_a_side_follows_from_the_shift(level):
    """Learned where it turns to the right, it is known where it turns down; a prediction is drawn to it."""
    ratio, half = TiltRatio(), translation(np.array([0.0, 10.0]))
    for _ in range(60):
        ratio.learn(level, MOTION, np.array([0, 0, -3.0, 0]), PRECISE)
    assert ratio.expected(level, MOTION) == pytest.approx([0, 0, -3.0, 0], abs=0.1)
    assert ratio.expected(level, half) == pytest.approx([0, 0, 0, -1.5], abs=0.1)
    assert np.sqrt(ratio.variances(level, MOTION))[2] < 0.5
    assert tilt_of(level, motion_prior(level, MOTION, LOOSE, ratio).start)[2] == pytest.approx(-3, abs=0.5)


@pytest.mark.parametrize("perspective", [3.0, 0.5])
def test_a_camera_that_begins_to_tilt_is_believed(level, perspective):
    """After a hundred frames without tilt: at once where a frame is sure of it, else after thirty."""
    ratio = TiltRatio()
    for tilt in [0.0] * 100 + [perspective] * (1 if perspective > 1 else 30):
        ratio.learn(level, MOTION, np.array([0, 0, tilt, tilt]), np.full(4, 0.1))
    assert np.sqrt(ratio.variances(level, MOTION))[2] > perspective / 2


def test_frames_that_show_no_tilt_teach_nothing(level):
    """What they seem to show is their error."""
    first = np.sqrt(TiltRatio().variances(level, MOTION))
    assert learned(level, np.full(4, 31.8), np.full(4, 1e4)) == pytest.approx(first, rel=0.4)


def test_a_prediction_is_drawn_to_a_similarity_by_a_camera_that_does_not_tilt(level):
    """As movers have bent it; the motion without the perspective stays."""
    still, free = TiltRatio(), TiltRatio()
    for _ in range(30):
        still.learn(level, MOTION, np.zeros(4), PRECISE)
    bent = tilted(level, 1.0)
    drawn, kept = (motion_prior(level, bent, LOOSE, ratio) for ratio in (still, free))
    assert abs(tilt_of(level, drawn.start)[2]) < 0.1
    assert tilt_of(level, kept.start)[2] > 0.9
    assert drawn.start @ [159.5, 89.5, 1] == pytest.approx(MOTION @ [159.5, 89.5, 1], abs=0.1)
    assert drawn.covariance[6, 6] < kept.covariance[6, 6] / 10


def test_what_earlier_frames_say_of_the_tilt_does_not_last(level):
    """Their errors are alike: the prediction uses them, its lasting information does not."""
    sure = np.diag((0.1 * STEP_RATIOS) ** 2)
    prior = motion_prior(level, MOTION, sure, TiltRatio())
    assert prior.covariance[6, 6] == pytest.approx(sure[6, 6], rel=0.01)
    assert 1 / prior.lasting[6, 6] == pytest.approx(TiltRatio().variances(level, MOTION)[2])
    assert prior.lasting[0, 0] == pytest.approx(1 / sure[0, 0])
