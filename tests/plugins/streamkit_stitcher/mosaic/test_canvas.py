"""The canvas that grows and halves."""

import numpy as np
import pytest

from streamkit_stitcher.homographies import project
from streamkit_stitcher.mosaic.canvas import Canvas


def paint(canvas, left, top, value):
    """Paints 40 x 30 px of the plane at a whole-pixel place, at full scale."""
    assert canvas.make_room(np.array([[left, top], [left + 39, top + 29]], dtype=float), 2)
    column, row = project(canvas.from_plane, np.array([[left, top]], dtype=float))[0].round().astype(int)
    canvas.pixels[row : row + 30, column : column + 40] = value
    canvas.depth[row : row + 30, column : column + 40] = 200


def test_growing_keeps_what_is_painted():
    """Ground on all four sides of the first piece leaves the first piece where it was."""
    canvas = Canvas(1_000_000)
    for left, top, value in ((0, 0, 50), (-90, -70, 60), (130, 5, 70), (3, 160, 80)):
        paint(canvas, left, top, value)
    places = np.array([[20.0, 15.0], [-70, -55], [150, 20], [23, 175]])
    cells = project(canvas.painted_from_plane, places).round().astype(int)
    assert canvas.painted()[cells[:, 1], cells[:, 0]].tolist() == [50, 60, 70, 80]
    assert canvas.painted().shape == (260, 260)


def test_at_the_limit_the_canvas_is_halved():
    """The painted box never has more pixels than allowed, and places stay right to a canvas pixel."""
    canvas = Canvas(10_000)
    paint(canvas, 1, 3, 50)
    assert canvas.make_room(np.array([[300.0, 200.0]]), 2)
    assert canvas.scale == 0.25
    assert canvas.painted().size <= 10_000
    column, row = project(canvas.painted_from_plane, np.array([[20.0, 17.0]]))[0].round().astype(int)
    assert canvas.painted()[row, column] == 50
    assert canvas.depth[canvas.depth > 0].min() == 200


def test_a_place_out_of_reach_changes_nothing():
    """Beyond a sixteenth of the resolution the canvas refuses."""
    canvas = Canvas(10_000)
    paint(canvas, 0, 0, 50)
    assert not canvas.make_room(np.array([[1e6, 1e6]]), 2)
    assert canvas.scale == 1.0
    assert canvas.painted().shape == (30, 40)


def test_halving_does_not_mix_in_the_unpainted():
    """Blocks that are painted in part become unpainted rather than dark."""
    canvas = Canvas(1_000_000)
    paint(canvas, 1, 1, 100)
    canvas._halve()
    assert set(np.unique(canvas.pixels)) == {0, 100}
    assert (canvas.pixels[canvas.depth > 0] == 100).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_first_picture_decides_the_colours(dimensions):
    """Grey stays grey and colour stays colour while the canvas grows."""
    canvas = Canvas(1_000_000)
    canvas.make_room(np.array([[0.0, 0.0], [9, 9]]), dimensions)
    canvas.make_room(np.array([[90.0, 90.0]]), 2)
    assert canvas.pixels.ndim == dimensions
