"""Video, photographs and cuts are told apart."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.footage import Footage
from streamkit_stitcher.registration.pairwise import WorkingImage


@pytest.fixture(scope="module")
def scenes(ground):
    """Frames of eight places that share nothing."""
    return [
        WorkingImage(ground[row : row + 360, column : column + 640], 1, 100)
        for row in (0, 1100)
        for column in (0, 700, 1400, 2100)
    ]


@pytest.fixture
def calm(scenes):
    """A video that shows the first scene for three frames."""
    footage = Footage()
    for _ in range(3):
        footage.continues(is_jump=False)
        footage.add(scenes[0], np.eye(3))
    return footage


def test_another_scene_after_calm_frames_is_a_cut(calm, scenes):
    """Also where the frames before moved: they are compared where they overlap."""
    assert calm.is_abrupt(scenes[1])
    assert not calm.is_abrupt(scenes[0])


def test_frames_that_moved_are_calm(ground, scenes):
    """A camera that moved by a tenth of the frame each time."""
    footage = Footage()
    for left in (0, 64, 128):
        footage.add(WorkingImage(ground[:360, left : left + 640], 1, 100), translation(np.array([64.0, 0.0])))
    assert footage.is_abrupt(scenes[5])


def test_a_scene_that_changes_with_every_frame_has_no_cut(calm, scenes):
    """Leaves before the camera; nor has one that was seen for two frames."""
    calm.add(scenes[1], np.eye(3))
    assert not calm.is_abrupt(scenes[2])
    calm.add(scenes[1], np.eye(3))
    assert not calm.is_abrupt(scenes[2])
    calm.add(scenes[1], np.eye(3))
    assert calm.is_abrupt(scenes[2])


def test_unlike_frames_are_photographs_until_frames_continued(scenes):
    """What was a video for a few frames may become photographs; what was one for long may not."""
    footage = Footage()
    assert footage.is_photograph(scenes[0], scenes[1])
    assert not footage.is_photograph(scenes[0], scenes[0])
    assert footage.continues(is_jump=False)
    assert footage.continues(is_jump=True)
    assert not footage.is_photograph(scenes[0], scenes[1])
    footage.recognised(is_photograph=False)
    assert footage.is_photograph(scenes[0], scenes[1])
    for _ in range(8):
        footage.continues(is_jump=False)
    footage.recognised(is_photograph=False)
    footage.restart()
    assert not footage.is_photograph(scenes[0], scenes[1])


def test_a_frame_found_far_from_the_one_before_is_a_photograph(scenes):
    """Those after it are, too, however alike they are, until one continues the one before."""
    footage = Footage()
    for _ in range(8):
        footage.continues(is_jump=False)
    footage.recognised(is_photograph=True)
    assert footage.is_photograph(scenes[0], scenes[0])
    assert not footage.continues(is_jump=True)
    footage.continues(is_jump=False)
    assert not footage.is_photograph(scenes[0], scenes[1])


def test_leaves_before_a_fixed_camera_are_no_cut(shared_folder, make_registrar):
    """They cover nearly all of the view for hundreds of frames: those frames are weak or lost."""
    registrar, states = make_registrar(), []
    for path in sorted((shared_folder / "data" / "change" / "sbi_foliage" / "input").iterdir()):
        states.append(registrar.register(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)).status)
    assert RegistrationStatus.CUT not in states
    assert states.count(RegistrationStatus.STILL) > len(states) / 2
    assert states.count(RegistrationStatus.LOST) < len(states) / 10
