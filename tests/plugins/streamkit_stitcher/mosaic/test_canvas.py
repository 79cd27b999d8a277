"""The canvas of tiles that grows, spills and halves."""

import numpy as np
import pytest

from streamkit.geometry.homography import project, translation
from streamkit_stitcher.mosaic.mosaic import Mosaic


def paint(canvas, left, top, value, channels=1):
    """Paints 40 x 30 px of the plane at a whole-pixel position, at full scale."""
    assert canvas.make_room(np.array([[left, top], [left + 39, top + 29]], dtype=float), channels)
    pixels = np.full((30, 40, canvas.channels), value, np.uint8)
    canvas.write(left, top, pixels, np.full((30, 40), 200, np.uint8))


def value_at(canvas, x, y):
    """The pixel that shows a point of the plane."""
    column, row = project(canvas.from_plane, np.array([[x, y]], dtype=float))[0].round().astype(int).tolist()
    return int(canvas.read(column, row, 1, 1)[0][0, 0, 0])


def test_growing_keeps_what_is_painted():
    """Ground on all four sides of the first piece leaves the first piece where it was."""
    canvas = Mosaic(1_000_000)
    for left, top, value in ((0, 0, 50), (-90, -70, 60), (530, 5, 70), (3, 660, 80)):
        paint(canvas, left, top, value)
    places = ((20, 15), (-70, -55), (550, 20), (23, 675))
    assert [value_at(canvas, *place) for place in places] == [50, 60, 70, 80]
    assert canvas.box == (-90, -70, 570, 690)
    assert value_at(canvas, 300, 300) == 0


def test_tiles_beyond_the_limit_go_to_a_file_and_come_back():
    """Memory holds a bounded number of tiles; what was spilled is read back pixel by pixel."""
    canvas = Mosaic(2_000_000)
    values = {600 * number: 10 + number for number in range(12)}
    for left, value in values.items():
        paint(canvas, left, 0, value)
    pages = canvas._tiles._pages
    assert [isinstance(page, np.memmap) for page in pages] == [False, True]
    assert len(pages[0]) <= 7
    assert {left: value_at(canvas, left + 20, 15) for left in values} == values
    canvas.close()


def test_at_the_last_limit_the_canvas_is_halved():
    """The box never has more pixels than allowed, and positions stay right to a canvas pixel."""
    canvas = Mosaic(10_000 // 16)
    paint(canvas, 1, 3, 50)
    assert canvas.make_room(np.array([[300.0, 200.0]]), 1)
    assert canvas.scale == 0.25
    left, top, right, bottom = canvas.box
    assert (right - left) * (bottom - top) <= 10_000
    assert value_at(canvas, 20, 17) == 50


def test_a_place_out_of_reach_changes_nothing():
    """Beyond a sixteenth of the resolution the canvas refuses."""
    canvas = Mosaic(10_000)
    paint(canvas, 0, 0, 50)
    assert not canvas.make_room(np.array([[1e6, 1e6]]), 1)
    assert canvas.scale == 1.0
    assert canvas.box == (0, 0, 40, 30)


def test_halving_does_not_mix_in_the_unpainted():
    """Blocks that are painted in part become unpainted rather than dark."""
    canvas = Mosaic(1_000_000)
    paint(canvas, 1, 1, 100)
    canvas._halve()
    pixels, depth = canvas.read(*canvas.box[:2], 25, 20)
    assert set(np.unique(pixels)) == {0, 100}
    assert (pixels[depth > 0] == 100).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_the_first_image_decides_the_colours(channels):
    """Grey stays grey and colour stays colour whatever comes later."""
    canvas = Mosaic(1_000_000)
    paint(canvas, 0, 0, 50, channels)
    paint(canvas, 90, 0, 60, 4 - channels)
    assert canvas.channels == channels
    assert value_at(canvas, 100, 10) == 60


def test_a_change_of_plane_leaves_the_painting_where_it_is():
    """After the plane moved by a shift, the same ground is at its shifted position."""
    canvas = Mosaic(1_000_000)
    paint(canvas, 0, 0, 50)
    canvas.move_plane(translation(np.array([1000.0, -500.0])))
    assert value_at(canvas, 1020, -485) == 50


@pytest.mark.parametrize("step", [200, 3000])
def test_a_preview_shows_the_whole_in_any_size(step):
    """Small or large, the preview shows everything, in proportion, with its homography."""
    canvas = Mosaic(64_000_000)
    for number in range(3):
        paint(canvas, step * number, step * number // 2, 100 + 50 * number)
    image, from_plane = canvas.preview(320, 240)
    assert image.shape == (240, 320, 1)
    assert len(np.unique(image)) > 3 if step == 200 else image.max() > 20
    place = project(from_plane, np.array([[20.0, 15.0], [2 * step + 20.0, step + 15.0]]))
    assert ((place > -1) & (place < (320, 240))).all()
    column, row = place[0].round().astype(int)
    assert image[row, column, 0] > 0


def test_pixels_of_a_preview_stay_while_the_mosaic_grows():
    """What was painted has the same pixels in the next preview, moved by blocks of 16, or a smaller scale."""
    canvas = Mosaic(64_000_000)
    paint(canvas, 0, 0, 100)
    before, place_before = canvas.preview(320, 240)
    scales = [1.0]
    for number in range(1, 25):
        paint(canvas, -45 * number, 32 * number, 100 + number)
        image, place = canvas.preview(320, 240)
        if place[0, 0] == scales[-1]:
            x, y = (place - place_before)[:2, 2].astype(int)
            assert (x % 16, y % 16) == (0, 0)
            moved = np.roll(before, (y, x), (0, 1))
            assert np.array_equal(image[moved > 100], moved[moved > 100])
        scales.append(place[0, 0])
        before, place_before = image, place
    assert set(scales) == {1.0, 0.75, 0.5, 0.375, 0.25}
    assert scales == sorted(scales, reverse=True)


def test_a_preview_shows_what_was_painted_since_the_last():
    """Cached tiles are refreshed: new paint shows in a far larger canvas."""
    canvas = Mosaic(64_000_000)
    paint(canvas, 0, 0, 100)
    paint(canvas, 4000, 1001, 100)
    before, _ = canvas.preview(320, 240)
    paint(canvas, 0, 0, 250)
    paint(canvas, 2003, 501, 250)
    after, from_plane = canvas.preview(320, 240)
    for x, y in ((20.0, 15.0), (2023.0, 516.0)):
        column, row = project(from_plane, np.array([[x, y]]))[0].round().astype(int)
        assert after[row, column, 0] > before[row, column, 0] + 20
