"""Which pictures are recorded, and when."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.mosaic.album import RecorderSettings
from streamkit_stitcher.mosaic.georeference import PositionFix
from streamkit_stitcher.mosaic.picture_store import PictureStore
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.plane.placement import Placement, Status

SMALL = (360, 640)


def placement(left=0.0, reference=0, **fields):
    """A placement shifted along x."""
    given = {"status": Status.OK, "anchored": True} | fields
    return Placement(np.eye(3), translation(np.array([left, 0.0])), reference, **given)


def add(recorder, where, picture, position=None):
    """Offers a picture; whether it was asked for."""
    asked = []
    recorder.add(where, SMALL, lambda: asked.append(1) or picture, position)
    return bool(asked)


@pytest.fixture
def picture(ground):
    """A picture of the ground."""
    return ground[:360, :640]


@pytest.fixture
def recorder(tmp_path):
    """A recorder of m.png that keeps the mosaic as it grows."""
    return MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), 64_000_000, final=False))


def test_new_ground_and_key_pictures_go_in(recorder, picture):
    """A picture of known ground is not even asked for."""
    assert add(recorder, placement(keyframe=True), picture)
    assert not add(recorder, placement(20.0), picture)
    assert add(recorder, placement(90.0), picture)
    assert add(recorder, placement(100.0, keyframe=True), picture)


def test_a_place_that_was_not_measured_never_goes_in(recorder, picture):
    """Lost and weak pictures stay out, whatever ground they claim to show."""
    assert not add(recorder, placement(500.0, status=Status.LOST, anchored=False), picture)
    assert recorder.finish() is None


def test_the_mosaic_is_written_once(recorder, picture, tmp_path):
    """finish() writes what there is and tells its size; a second call has nothing left."""
    add(recorder, placement(keyframe=True), picture)
    written = recorder.finish()
    assert (written.width, written.height, written.pictures, written.reference) == (640, 360, 1, 0)
    assert not written.final
    assert np.array_equal(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE), picture)
    assert recorder.finish() is None


def test_without_a_number_the_plane_that_covers_most_is_kept(recorder, picture, tmp_path):
    """A large plane is not overwritten by the small one after it."""
    add(recorder, placement(keyframe=True), picture)
    add(recorder, placement(300.0, keyframe=True), picture)
    assert recorder.is_other_plane(placement(reference=1))
    assert recorder.finish().width == 940
    add(recorder, placement(reference=1, keyframe=True), picture)
    assert recorder.finish() is None
    assert cv2.imread(str(tmp_path / "m.png")).shape[1] == 940


def test_with_a_number_each_plane_has_a_file(picture, tmp_path):
    """%d is the number of the plane."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m-%d.png"), 64_000_000))
    for reference in (0, 1):
        add(recorder, placement(reference=reference, keyframe=True), picture)
        recorder.finish({0: np.eye(3)})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m-0.png", "m-1.png"]


def test_pictures_out_of_reach_are_counted(recorder, picture):
    """A refused picture leaves the mosaic as it was."""
    add(recorder, placement(keyframe=True), picture)
    add(recorder, placement(1e8, keyframe=True), picture)
    assert recorder.refused == 1
    assert recorder.finish().pictures == 1


def test_a_plane_that_moves_takes_its_mosaic_along(recorder, ground, tmp_path):
    """After a change of plane the next picture lands beside the first, not on it."""
    add(recorder, placement(keyframe=True), ground[:360, :640])
    step = translation(np.array([-1000.0, 0.0]))
    moved = placement(-700.0, 1, keyframe=True, change=step, exchange=step)
    assert not recorder.is_other_plane(moved)
    add(recorder, moved, ground[:360, 300:940])
    assert recorder.finish().width == 940
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(found.astype(int) - ground[:360, :940]).max() <= 1


def test_what_is_painted_stays_where_key_pictures_are_put_right(recorder, ground, tmp_path):
    """Where only what lies about a picture moves, it is painted where it belongs beside all the others."""
    add(recorder, placement(keyframe=True), ground[:360, :640])
    step = translation(np.array([-50.0, 0.0]))
    add(recorder, placement(300.0, keyframe=True, change=step), ground[:360, 300:940])
    assert recorder.finish().width == 940
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(found.astype(int) - ground[:360, :940]).max() <= 1


def test_a_plane_that_cannot_be_drawn_on_begins_another_mosaic(picture, tmp_path):
    """Though it is related to the one before, each has its file, and lies as it lies on its own plane."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m-%d.png"), 64_000_000, final=False))
    add(recorder, placement(keyframe=True), picture)
    step = translation(np.array([-1000.0, 0.0]))
    opened = placement(0.0, 1, keyframe=True, change=step, opens=True)
    assert recorder.is_other_plane(opened)
    recorder.finish()
    add(recorder, opened, picture)
    add(recorder, placement(300.0, 1, keyframe=True), picture)
    assert recorder.finish().width == 940
    assert cv2.imread(str(tmp_path / "m-0.png")).shape[1] == 640


def test_the_final_mosaic_takes_the_adjusted_places(ground, tmp_path):
    """Pictures follow the key picture they were measured against; the misfit to positions is told."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), 64_000_000))
    # 0.1 m a pixel on the equator, flown east.
    fixes = [PositionFix(0.0, left * 0.1 / 111_319.49) for left in (0, 300, 600)]
    for number, left in enumerate((0.0, 340.0, 560.0)):
        where = placement(left, keyframe=True, key_index=number)
        add(recorder, where, ground[:360, 300 * number : 300 * number + 640], fixes[number])
    written = recorder.finish({n: translation(np.array([300.0 * n, 0.0])) for n in range(3)}, 0.1)
    assert (written.width, written.final, written.rmse_px) == (1240, True, 0.1)
    assert written.position_misfit_m == pytest.approx(0.0, abs=0.01)
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE).astype(int)
    assert np.abs(found[4:-4, 4:-4] - ground[4:356, 4:1236]).max() <= 2


def test_a_mosaic_that_somebody_asks_for_is_painted_from_then_on(ground, tmp_path):
    """What came before is laid out as it lay, on the plane of today; what comes after is added."""
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), 64_000_000))
    assert recorder.is_empty
    add(recorder, placement(keyframe=True), ground[:360, :640])
    step = translation(np.array([-1000.0, 0.0]))
    moved = placement(-700.0, 1, keyframe=True, change=step, exchange=step)
    add(recorder, moved, ground[:360, 300:940])
    assert not recorder.is_empty
    assert np.abs(recorder.mosaic.picture().astype(int) - ground[:360, :940]).max() <= 1
    add(recorder, placement(-400.0, 1, keyframe=True), ground[:360, 600:1240])
    assert np.abs(recorder.mosaic.picture().astype(int) - ground[:360, :1240]).max() <= 1


@pytest.mark.parametrize("limit", ["bytes", "number"])
def test_pictures_that_are_not_kept_are_in_the_mosaic_as_it_grew(ground, tmp_path, monkeypatch, limit):
    """Where the store is full, nothing is lost but the final adjustment."""
    if limit == "bytes":
        monkeypatch.setattr(
            "streamkit_stitcher.mosaic.album.PictureStore", lambda: PictureStore(2 * 360 * 640, 0)
        )
    else:
        monkeypatch.setattr("streamkit_stitcher.mosaic.album._MOST_KEPT", 2)
    recorder = MosaicRecorder(RecorderSettings(str(tmp_path / "m.png"), 64_000_000))
    for number in range(4):
        where = placement(300.0 * number, keyframe=True, key_index=number)
        add(recorder, where, ground[:360, 300 * number : 300 * number + 640])
    written = recorder.finish({n: translation(np.array([300.0 * n, 0.0])) for n in range(4)})
    assert (written.width, written.pictures, written.final) == (1540, 4, False)
    found = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE).astype(int)
    assert np.abs(found - ground[:360, :1540]).max() <= 1


def test_a_geotiff_has_north_on_top(ground, tmp_path):
    """The mosaic is turned by its pictures' positions; a PNG of the same flight is not."""
    tifffile = pytest.importorskip("tifffile")
    pytest.importorskip("pyproj")
    for name in ("m.tif", "m.png"):
        recorder = MosaicRecorder(RecorderSettings(str(tmp_path / name), 64_000_000))
        for number in range(4):
            # Flown north, to the right of the plane: 0.1 m a pixel.
            fix = PositionFix(number * 30.0 / 110_574.0, 3.0)
            where = placement(300.0 * number, keyframe=True, key_index=number)
            add(recorder, where, ground[:360, 300 * number : 300 * number + 640], fix)
        recorder.finish({n: translation(np.array([300.0 * n, 0.0])) for n in range(4)})
    upright = tifffile.imread(tmp_path / "m.tif")
    assert upright.shape == pytest.approx((1540, 360), abs=2)
    flat = cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_GRAYSCALE)
    assert flat.shape == (360, 1540)
    turned = np.rot90(flat)[10:-10, 10:-10].astype(float)
    shown = upright[10 : 10 + turned.shape[0], 10 : 10 + turned.shape[1]]
    assert np.abs(shown - turned).mean() < 12
