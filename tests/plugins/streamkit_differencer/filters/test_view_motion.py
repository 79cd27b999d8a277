"""How a camera moves over the ground, from the ground's homographies."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import inverse, normalised, project
from streamkit_differencer.canvas import Motion
from streamkit_differencer.differencer import Differencer
from streamkit_differencer.filters.view_motion import FOCAL_LENGTH, MAX_SHIFT_PX, ViewMotionEstimator

SHAPE = (360, 640)
CAMERA = np.array([[FOCAL_LENGTH * 640, 0.0, 319.5], [0.0, FOCAL_LENGTH * 640, 179.5], [0.0, 0.0, 1.0]])
HEIGHT = 20.0
RANDOM = np.random.default_rng(3)
GROUND = cv2.resize(RANDOM.integers(70, 120, (150, 80)).astype(np.uint8), (800, 1500))
ROOF = cv2.resize(RANDOM.integers(150, 220, (8, 12)).astype(np.uint8), (120, 80))


class Flight:
    """A camera at 20 m that looks down by a pitch and turns while it flies ahead or sideways."""

    def __init__(self, pitch, speed, turn_deg=0.0, sideways=0.0):
        self._pitch, self._turn = np.radians(pitch), np.radians(turn_deg)
        self._velocity = np.array([sideways, speed, 0.0])

    def world_to_pixels(self, time):
        """float64[3, 4]; the world has x to the right, y ahead and z upwards, the ground is z = 0."""
        heading = self._turn * time
        ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
        right = np.array([np.cos(heading), -np.sin(heading), 0.0])
        axis = np.cos(self._pitch) * ahead - np.sin(self._pitch) * np.array([0.0, 0.0, 1.0])
        rotation = np.array([right, np.cross(axis, right), axis])
        position = self._velocity * time + np.array([0.0, 0.0, HEIGHT])
        return CAMERA @ np.column_stack([rotation, -rotation @ position])

    def ground(self, time):
        """float64[3, 3], the ground to pixels."""
        return normalised(self.world_to_pixels(time)[:, [0, 1, 3]])

    def to_first(self, time):
        """float64[3, 3], pixels to those of the first frame, as a registration gives them."""
        return normalised(self.ground(0) @ inverse(self.ground(time)))

    def picture(self, time):
        """Textured ground from x = -40, y = -20 on, and a roof 5 m above it; uint8[h, w]."""
        return self._draw(ROOF, (-4.0, 24.0, 5.0), time, self._draw(GROUND, (-40.0, -20.0, 0.0), time, 0))

    def _draw(self, image, corner, time, below):
        """An image of 10 px a metre that lies level with its first pixel at a corner, over a picture."""
        x, y, z = corner
        to_world = np.array([[0.1, 0.0, x], [0.0, 0.1, y], [0.0, 0.0, z], [0.0, 0.0, 1.0]])
        drawn = cv2.warpPerspective(image, self.world_to_pixels(time) @ to_world, SHAPE[::-1])
        return np.where(drawn > 0, drawn, np.uint8(below))

    def pixel(self, point, time):
        """float64[1, 2], where a point of the world is seen."""
        x, y, depth = self.world_to_pixels(time) @ np.append(point, 1.0)
        return np.array([[x, y]]) / depth


@pytest.mark.parametrize("pitch", [90.0, 50.0, 20.0])
@pytest.mark.parametrize("turn_deg", [0.0, 0.6])
def test_tops_of_tall_objects_were_where_it_says(pitch, turn_deg):
    """5 m tall under a camera at 20 m, straight down and obliquely; the mean lags where the camera turns."""
    flight, estimator = Flight(pitch, 0.4, turn_deg), ViewMotionEstimator()
    for time in range(40):
        view = estimator.update(flight.to_first(time), SHAPE, 3, 5.0 / (HEIGHT - 5.0))
    point = np.array([1.0, 0.4 * 39 + 15.0 / np.tan(np.radians(pitch)) + 1.0, 5.0])
    now, before = (project(flight.to_first(time), flight.pixel(point, time)) for time in (39, 36))
    length = np.hypot(*(before - now)[0])
    assert length > 0.5
    assert np.abs(view.shifts(now)[0] - (before - now)).max() < (0.35 if turn_deg else 0.05) * length


def test_the_ground_does_not_shift():
    """An object without height is where the registration puts it."""
    flight, estimator = Flight(40.0, 0.4), ViewMotionEstimator()
    for time in range(5):
        view = estimator.update(flight.to_first(time), SHAPE, 3, 0.0)
    assert np.abs(view.shifts(np.array([[320.0, 300.0]]))[0]).max() < 1e-9


def test_a_camera_that_only_turns_has_no_parallax():
    """Its view moves, and is blurred along that way alone."""
    flight, estimator = Flight(40.0, 0.0, 1.0), ViewMotionEstimator()
    for time in range(5):
        view = estimator.update(flight.to_first(time), SHAPE, 3, 0.5)
    assert view.translation is None
    assert view.is_flight
    [shifts] = view.shifts(np.array([[10.0, 10.0], [300.0, 200.0]]))
    np.testing.assert_allclose(shifts, [0.5 * view.step] * 2)


def test_a_camera_at_rest_explains_nothing():
    """Neither by parallax nor by its motion."""
    estimator = ViewMotionEstimator()
    for _ in range(5):
        view = estimator.update(np.eye(3), SHAPE, 3, 0.5)
    assert not view.is_flight
    assert view.shifts(np.array([[10.0, 10.0]])) == []


def test_the_canvas_may_move_under_the_frames():
    """The last frames move along: the motion of the view stays what it is."""
    flight, moved, still = Flight(60.0, 0.4), ViewMotionEstimator(), ViewMotionEstimator()
    change = np.array([[1.0, 0.0, 40.0], [0.0, 1.0, -30.0], [0.0, 0.0, 1.0]])
    for time in range(4):
        first = still.update(flight.to_first(time), SHAPE, 3, 0.5)
        if time < 3:
            moved.update(flight.to_first(time), SHAPE, 3, 0.5)
    moved.move(change)
    second = moved.update(change @ flight.to_first(3), SHAPE, 3, 0.5)
    np.testing.assert_allclose(second.step, first.step, atol=1e-9)
    points = np.array([[100.0, 200.0]])
    for one, other in zip(first.shifts(points), second.shifts(project(change, points)), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)
    moved.restart()
    assert not moved.update(flight.to_first(4), SHAPE, 3, 0.5).is_flight


def test_no_way_is_searched_without_end():
    """A low camera in fast flight shifts what is next to it beyond the frame."""
    flight, estimator = Flight(50.0, 4.0), ViewMotionEstimator()
    for time in range(4):
        view = estimator.update(flight.to_first(time), SHAPE, 3, 1.0)
    parallax = view.shifts(np.array([[320.0, 300.0]]))[0]
    assert np.hypot(*parallax[0]) == pytest.approx(MAX_SHIFT_PX)


def test_a_roof_that_a_camera_circles_is_left_out():
    """Its view hardly moves, and the roof shifts over the ground; a car beside it stays."""
    flight, found = Flight(35.0, 0.0, -0.8, sideways=0.4), {}
    for has_car in (False, True):
        differencer, boxes = Differencer(), []
        for time in range(50):
            picture = flight.picture(time)
            if has_car:
                x, y = flight.pixel((7.0, 18.0 + 0.2 * time, 0.0), time)[0].astype(int)
                picture[y - 8 : y + 8, x - 14 : x + 14] = 240
            result = differencer.update(picture, Motion(flight.to_first(time)))
            boxes.append(len(result.objects))
        found[has_car] = boxes[30:]
    assert np.mean(found[False]) < 0.1
    assert np.mean(found[True]) > 0.9
