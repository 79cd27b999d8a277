"""Selection of frames, and writing."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import centre, translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.mosaic.frame_store import FrameStore
from streamkit_stitcher.mosaic.georeference import GroundView
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.plane.frame_registration import FrameRegistration

SMALL = (360, 640)


def registered(left=0.0, reference=0, **fields):
    """A placement shifted along x."""
    given = {"status": RegistrationStatus.OK, "measured": True} | fields
    return FrameRegistration(np.eye(3), translation(np.array([left, 0.0])), reference, **given)


def at(latitude, longitude):
    """What a frame shows whose middle has a position."""
    return GroundView(centre(SMALL)[np.newaxis], np.array([[latitude, longitude]]))


def add(recorder, where, frame, position=None):
    """Offers a frame; whether its pixels were loaded."""
    asked = []
    recorder.add(where, SMALL, lambda: asked.append(1) or frame, position)
    return bool(asked)


@pytest.fixture
def frame(ground):
    """A frame of the ground."""
    return ground[:360, :640]


@pytest.fixture
def recorder(tmp_path):
    """A recorder of m.png that keeps the mosaic as it grows."""
    return MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), final=False))


def test_new_ground_and_keyframes_go_in(recorder, frame):
    """A frame of covered ground is not even loaded."""
    assert add(recorder, registered(keyframe=True), frame)
    assert not add(recorder, registered(20.0), frame)
    assert add(recorder, registered(90.0), frame)
    assert add(recorder, registered(100.0, keyframe=True), frame)


def test_a_place_that_was_not_measured_never_goes_in(recorder, frame):
    """Lost and weak frames stay out, whatever ground they claim to show."""
    assert not add(recorder, registered(500.0, status=RegistrationStatus.LOST, measured=False), frame)
    assert recorder.finish() is None


def test_the_mosaic_is_written_once(recorder, frame, tmp_path):
    """finish() writes the mosaic and returns its size; a second call has nothing left."""
    add(recorder, registered(keyframe=True), frame)
    written = recorder.finish()
    assert (written.width, written.height, written.pictures, written.reference) == (640, 360, 1, 0)
    assert not written.final
    assert np.array_equal(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE), frame)
    assert recorder.finish() is None


@pytest.mark.parametrize("final", [True, False])
def test_a_mosaic_may_be_saved_while_it_grows(frame, tmp_path, final):
    """The file has what was painted so far, and the last one is as without; a smaller plane is not saved."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), final=final))
    recorder.save()
    assert not list(tmp_path.iterdir())
    for left, width in ((0.0, 640), (300.0, 940)):
        add(recorder, registered(left, keyframe=True), frame)
        recorder.save()
        assert cv2.imread(str(tmp_path / "m.png")).shape[1] == width
    assert recorder.finish().width == 940
    add(recorder, registered(reference=1, keyframe=True), frame)
    recorder.save()
    assert cv2.imread(str(tmp_path / "m.png")).shape[1] == 940


def test_without_a_number_the_plane_that_covers_most_is_kept(recorder, frame, tmp_path):
    """A large plane is not overwritten by the small one after it."""
    add(recorder, registered(keyframe=True), frame)
    add(recorder, registered(300.0, keyframe=True), frame)
    assert recorder.is_new_plane(registered(reference=1))
    assert recorder.finish().width == 940
    add(recorder, registered(reference=1, keyframe=True), frame)
    assert recorder.finish() is None
    assert cv2.imread(str(tmp_path / "m.png")).shape[1] == 940


def test_with_a_number_each_plane_has_a_file(frame, tmp_path):
    """%d is the number of the plane."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m-%d.png")))
    for reference in (0, 1):
        add(recorder, registered(reference=reference, keyframe=True), frame)
        recorder.finish({reference: {0: np.eye(3)}})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m-0.png", "m-1.png"]


def test_frames_out_of_reach_are_counted(recorder, frame):
    """A refused frame leaves the mosaic as it was."""
    add(recorder, registered(keyframe=True), frame)
    add(recorder, registered(1e8, keyframe=True), frame)
    assert recorder.refused == 1
    assert recorder.finish().pictures == 1


def test_a_plane_that_moves_takes_its_mosaic_along(recorder, ground, tmp_path):
    """After a change of plane the next frame is painted next to the first, not on it."""
    add(recorder, registered(keyframe=True), ground[:360, :640])
    step = translation(np.array([-1000.0, 0.0]))
    moved = registered(-700.0, 1, keyframe=True, reference_change=step, rebase=step)
    assert not recorder.is_new_plane(moved)
    add(recorder, moved, ground[:360, 300:940])
    assert recorder.finish().width == 940
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(found.astype(int) - ground[:360, :940]).max() <= 1


def test_what_is_painted_stays_where_keyframes_are_put_right(recorder, ground, tmp_path):
    """A local correction does not move painted frames."""
    add(recorder, registered(keyframe=True), ground[:360, :640])
    step = translation(np.array([-50.0, 0.0]))
    add(recorder, registered(300.0, keyframe=True, reference_change=step), ground[:360, 300:940])
    assert recorder.finish().width == 940
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(found.astype(int) - ground[:360, :940]).max() <= 1


def test_a_frame_that_opens_a_plane_begins_another_mosaic(frame, tmp_path):
    """Though `change` relates both planes, each has its file."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m-%d.png"), final=False))
    add(recorder, registered(keyframe=True), frame)
    step = translation(np.array([-1000.0, 0.0]))
    opened = registered(0.0, 1, keyframe=True, reference_change=step, opens_plane=True)
    assert recorder.is_new_plane(opened)
    recorder.finish()
    add(recorder, opened, frame)
    add(recorder, registered(300.0, 1, keyframe=True), frame)
    assert recorder.finish().width == 940
    assert cv2.imread(str(tmp_path / "m-0.png")).shape[1] == 640


def test_the_final_mosaic_uses_the_adjusted_homographies(ground, tmp_path):
    """Frames follow the keyframe they were measured against; the error to the positions is reported."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png")))
    # 0.1 m a pixel on the equator, flown east.
    fixes = [at(0.0, left * 0.1 / 111_319.49) for left in (0, 300, 600)]
    for number, left in enumerate((0.0, 340.0, 560.0)):
        where = registered(left, keyframe=True, key_index=number)
        add(recorder, where, ground[:360, 300 * number : 300 * number + 640], fixes[number])
    written = recorder.finish({0: {n: translation(np.array([300.0 * n, 0.0])) for n in range(3)}}, 0.1)
    assert (written.width, written.final, written.rmse_px) == (1240, True, 0.1)
    assert written.position_misfit_m == pytest.approx(0.0, abs=0.01)
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE).astype(int)
    assert np.abs(found[4:-4, 4:-4] - ground[4:356, 4:1236]).max() <= 2


def test_a_mosaic_is_painted_from_its_first_use_on(ground, tmp_path):
    """Earlier frames are painted on the present plane; later ones are added."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png")))
    assert recorder.is_empty
    add(recorder, registered(keyframe=True), ground[:360, :640])
    step = translation(np.array([-1000.0, 0.0]))
    moved = registered(-700.0, 1, keyframe=True, reference_change=step, rebase=step)
    add(recorder, moved, ground[:360, 300:940])
    assert not recorder.is_empty
    assert np.abs(recorder.frames.mosaic.image().astype(int) - ground[:360, :940]).max() <= 1
    add(recorder, registered(-400.0, 1, keyframe=True), ground[:360, 600:1240])
    assert np.abs(recorder.frames.mosaic.image().astype(int) - ground[:360, :1240]).max() <= 1


@pytest.mark.parametrize("limit", ["bytes", "number"])
def test_frames_that_are_not_kept_are_in_the_mosaic_as_it_grew(ground, tmp_path, monkeypatch, limit):
    """Where the store is full, nothing is lost but the final adjustment."""
    if limit == "bytes":
        monkeypatch.setattr(
            "streamkit_stitcher.mosaic.mosaic_frames.FrameStore", lambda: FrameStore(2 * 360 * 640, 0)
        )
    else:
        monkeypatch.setattr("streamkit_stitcher.mosaic.frame_store.MAX_FRAMES", 2)
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png")))
    for number in range(4):
        where = registered(300.0 * number, keyframe=True, key_index=number)
        add(recorder, where, ground[:360, 300 * number : 300 * number + 640])
    written = recorder.finish({0: {n: translation(np.array([300.0 * n, 0.0])) for n in range(4)}})
    assert (written.width, written.pictures, written.final) == (1540, 4, False)
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE).astype(int)
    assert np.abs(found - ground[:360, :1540]).max() <= 1


def test_a_geotiff_has_north_on_top(ground, tmp_path):
    """The mosaic is turned by its frames' positions; a PNG of the same flight is not."""
    tifffile = pytest.importorskip("tifffile")
    pytest.importorskip("pyproj")
    for name in ("m.tif", "m.png"):
        recorder = MosaicRecorder(RecorderSettings(str(tmp_path / name)))
        for number in range(4):
            # Flown north, to the right of the plane: 0.1 m a pixel.
            fix = at(number * 30.0 / 110_574.0, 3.0)
            where = registered(300.0 * number, keyframe=True, key_index=number)
            add(recorder, where, ground[:360, 300 * number : 300 * number + 640], fix)
        recorder.finish({0: {n: translation(np.array([300.0 * n, 0.0])) for n in range(4)}})
    upright = tifffile.imread(tmp_path / "m.tif")
    assert upright.shape == pytest.approx((1540, 360), abs=2)
    flat = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert flat.shape == (360, 1540)
    turned = np.rot90(flat)[10:-10, 10:-10].astype(float)
    shown = upright[10 : 10 + turned.shape[0], 10 : 10 + turned.shape[1]]
    assert np.abs(shown - turned).mean() < 12


@pytest.mark.parametrize("final", [True, False])
def test_what_no_frame_shows_is_no_data(tmp_path, final):
    """Black ground is not taken for a gap: it is 1, and a TIFF declares 0 as no data."""
    tifffile = pytest.importorskip("tifffile")
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.tif"), final=final))
    for number in range(2):
        black = np.zeros((*SMALL, 3), np.uint8)
        shift = translation(np.array([500.0, 200.0]) * number)
        where = registered(keyframe=True, key_index=number)
        add(recorder, replace(where, to_reference=shift), black)
    recorder.finish({0: {n: translation(np.array([500.0, 200.0]) * n) for n in range(2)}})
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        assert file.pages[0].tags[42113].value == "0"
        image = file.pages[0].asarray()
    assert (image[20:340, 20:620] == 1).all()
    assert (image[380:540, 20:480] == 0).all()
