"""Which pictures are recorded, and when."""

import cv2
import numpy as np
import pytest

from streamkit_stitcher.homographies import translation
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.plane.tracker import Placement, Status

SMALL = (360, 640)


def placement(left=0.0, reference=0, **fields):
    """A placement shifted along x."""
    given = {"status": Status.OK, "anchored": True} | fields
    return Placement(np.eye(3), translation(np.array([left, 0.0])), reference, **given)


def add(recorder, where, picture):
    """Offers a picture; whether it was asked for, and what was written."""
    asked = []
    written = recorder.add(where, SMALL, lambda: asked.append(1) or picture)
    return bool(asked), written


@pytest.fixture
def picture(ground):
    """A picture of the ground."""
    return ground[:360, :640]


@pytest.fixture
def recorder(tmp_path):
    """A recorder of m.png."""
    return MosaicRecorder(str(tmp_path / "m.png"), 64_000_000)


def test_new_ground_and_key_pictures_go_in(recorder, picture):
    """A picture of known ground is not even asked for."""
    assert add(recorder, placement(keyframe=True), picture)[0]
    assert not add(recorder, placement(20.0), picture)[0]
    assert add(recorder, placement(90.0), picture)[0]
    assert add(recorder, placement(100.0, keyframe=True), picture)[0]


def test_a_place_that_was_not_measured_never_goes_in(recorder, picture):
    """Lost and weak pictures stay out, whatever ground they claim to show."""
    assert not add(recorder, placement(500.0, status=Status.LOST, anchored=False), picture)[0]
    assert recorder.finish() is None


def test_the_mosaic_is_written_once(recorder, picture, tmp_path):
    """finish() writes what there is and tells its size; a second call has nothing left."""
    add(recorder, placement(keyframe=True), picture)
    written = recorder.finish()
    assert (written.width, written.height, written.pictures, written.reference) == (640, 360, 1, 0)
    assert np.array_equal(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE), picture)
    assert recorder.finish() is None


def test_without_a_number_the_plane_that_covers_most_is_kept(recorder, picture, tmp_path):
    """A large plane is not overwritten by the small one after it."""
    add(recorder, placement(keyframe=True), picture)
    add(recorder, placement(300.0, keyframe=True), picture)
    _, first = add(recorder, placement(reference=1, keyframe=True), picture)
    assert first.width == 940
    assert recorder.finish() is None
    assert cv2.imread(str(tmp_path / "m.png")).shape[1] == 940


def test_with_a_number_each_plane_has_a_file(picture, tmp_path):
    """%d is the number of the plane."""
    recorder = MosaicRecorder(str(tmp_path / "m-%d.png"), 64_000_000)
    add(recorder, placement(keyframe=True), picture)
    add(recorder, placement(reference=1, keyframe=True), picture)
    recorder.finish()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m-0.png", "m-1.png"]


def test_pictures_out_of_reach_are_counted(picture, tmp_path):
    """A refused picture leaves the mosaic as it was."""
    recorder = MosaicRecorder(str(tmp_path / "m.png"), 1_000_000)
    add(recorder, placement(keyframe=True), picture)
    add(recorder, placement(1e8, keyframe=True), picture)
    assert recorder.refused == 1
    assert recorder.finish().pictures == 1
