"""Where frames lie on the canvas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.geometry.homography import project, translation
from streamkit_differencer.canvas import Canvas, CanvasChange, Motion, working_to_frame

SIZE = (160, 90)
CORNERS = np.array([[-0.5, -0.5], [159.5, -0.5], [159.5, 89.5], [-0.5, 89.5]])


def turned(angle, zoom, dx=0.0, dy=0.0):
    """A similarity."""
    cos, sin = zoom * np.cos(angle), zoom * np.sin(angle)
    return np.array([[cos, -sin, dx], [sin, cos, dy], [0, 0, 1.0]])


def test_halving_moves_pixel_centres_by_half_a_pixel():
    """The first pixel of a grid halved once covers frame pixels 0 and 1, whose middle is 0.5."""
    points = np.array([[0.0, 0.0], [10.0, 3.0]])
    assert project(working_to_frame(1), points).tolist() == points.tolist()
    assert project(working_to_frame(2), points).tolist() == [[0.5, 0.5], [20.5, 6.5]]
    assert project(working_to_frame(4), points).tolist() == [[1.5, 1.5], [41.5, 13.5]]


def test_the_first_frame_lies_in_the_middle_of_its_canvas():
    """The canvas of an anchor is its image with a margin of 16 % of its width on each side."""
    canvas = Canvas(SIZE, 2)
    place = canvas.place(Motion(turned(0.3, 5.0, 1000.0, -70.0)))
    assert place.change is CanvasChange.NEW
    np.testing.assert_allclose(place.working_to_canvas, translation((26, 26)), atol=1e-9)
    assert canvas.size == (212, 142)


@pytest.mark.parametrize("scale", [1, 2, 4])
def test_ground_points_keep_their_canvas_pixels(scale):
    """Along a flight, a point of the ground moves on the canvas only by the changes that are reported."""
    canvas = Canvas(SIZE, scale)
    ground = np.array([[300.0, 200.0], [340.0, 260.0]])
    on_canvas, seen = None, set()
    for time in range(120):
        to_reference = turned(0.004 * time, 1.004**time, 3.1 * time, 1.7 * time)
        place = canvas.place(Motion(to_reference))
        seen.add(place.change)
        to_working = np.linalg.inv(to_reference @ working_to_frame(scale))
        now = project(place.working_to_canvas @ to_working, ground)
        if on_canvas is not None:
            np.testing.assert_allclose(now, project(place.canvas_change, on_canvas), atol=1e-6)
        on_canvas = now
        corners = project(place.working_to_canvas, CORNERS)
        assert (corners >= -0.5 - 1e-6).all()
        assert (corners <= np.array(canvas.size) - 0.5 + 1e-6).all()
    assert seen == {CanvasChange.NEW, CanvasChange.NONE, CanvasChange.SCROLL, CanvasChange.REANCHOR}


def test_a_pan_scrolls_by_whole_pixels():
    """Leaving the margin sideways moves the canvas without resampling."""
    canvas = Canvas(SIZE, 2)
    changes = [canvas.place(Motion(translation((7.3 * time, 2.2 * time)))) for time in range(40)]
    scrolls = [place.canvas_change for place in changes if place.change is CanvasChange.SCROLL]
    assert scrolls
    for change in scrolls:
        np.testing.assert_array_equal(change, np.round(change))
        np.testing.assert_array_equal(change[:2, :2], np.eye(2))
    assert CanvasChange.REANCHOR not in {place.change for place in changes}


@pytest.mark.parametrize(
    ("zoom", "expected"),
    [(1.1, CanvasChange.NONE), (1.13, CanvasChange.REANCHOR), (0.88, CanvasChange.REANCHOR)],
)
def test_a_change_of_scale_reanchors(zoom, expected):
    """The frame's area on the canvas may be 0.8 to 1.25 of what it was."""
    canvas = Canvas(SIZE, 2)
    canvas.place(Motion(np.eye(3)))
    assert canvas.place(Motion(turned(0.0, zoom, -15 * (zoom - 1), -9 * (zoom - 1)))).change is expected


def test_a_new_plane_with_its_change_moves_nothing():
    """With reference_change the same frame lies at the same canvas pixels under the new plane's number."""
    first, second = Canvas(SIZE, 2), Canvas(SIZE, 2)
    change = turned(0.7, 1.6, 55.0, -20.0)
    for canvas in (first, second):
        canvas.place(Motion(np.eye(3), reference=4))
    moved = turned(0.02, 1.01, 3.0, 2.0)
    same = first.place(Motion(moved, reference=4))
    other = second.place(Motion(change @ moved, reference=5, reference_change=change))
    assert other.change is same.change is CanvasChange.NONE
    np.testing.assert_allclose(other.working_to_canvas, same.working_to_canvas, atol=1e-9)
    after = second.place(Motion(change @ moved, reference=5))
    np.testing.assert_allclose(after.working_to_canvas, same.working_to_canvas, atol=1e-9)


def test_a_new_plane_without_its_change_begins_anew():
    """Nothing relates the old canvas to a plane of another number."""
    canvas = Canvas(SIZE, 2)
    canvas.place(Motion(np.eye(3), reference=1))
    assert canvas.place(Motion(np.eye(3), reference=2)).change is CanvasChange.NEW


@pytest.mark.parametrize(
    "matrix",
    [
        np.full((3, 3), np.nan),
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, 0.0]),
        np.diag([1.0, 0.0, 1.0]),
        np.eye(2),
        np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]]),
        np.diag([1e9, 1e9, 1.0]),
    ],
    ids=["nan", "zero", "no-scale", "flat", "shape", "horizon", "huge"],
)
def test_a_matrix_that_is_no_homography_of_the_frame_is_refused(matrix):
    """The frame is not placed, and the canvas is as it was for the next one."""
    canvas = Canvas(SIZE, 2)
    assert canvas.place(Motion(matrix)) is None
    canvas.place(Motion(np.eye(3)))
    assert canvas.place(Motion(matrix)) is None
    place = canvas.place(Motion(translation((4.0, 2.0))))
    np.testing.assert_allclose(place.working_to_canvas, translation((28.0, 27.0)), atol=1e-9)


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.floats(-3.2, 3.2), st.floats(0.5, 2.0), st.floats(-500.0, 500.0), st.floats(-500.0, 500.0)
        ),
        min_size=1,
        max_size=8,
    )
)
def test_every_placed_frame_lies_on_the_canvas(moves):
    """Whatever the camera does, a placed frame's corners are within the canvas."""
    canvas = Canvas(SIZE, 2)
    limit = np.array(canvas.size) - 0.5
    for move in moves:
        place = canvas.place(Motion(turned(*move)))
        corners = project(place.working_to_canvas, CORNERS)
        assert (corners >= -0.5 - 1e-6).all()
        assert (corners <= limit + 1e-6).all()
