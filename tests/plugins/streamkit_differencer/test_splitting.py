"""Objects that stand close together, taken apart where the ground shows between them."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.canvas import FIXED, working_to_frame
from streamkit_differencer.differencer import Differencer
from streamkit_differencer.objects import chosen, find_objects
from streamkit_differencer.refinement import FrameImages
from streamkit_differencer.settings import DifferencerSettings, ObjectSettings
from streamkit_differencer.splitting import split_objects, typical_area

SHAPE = (400, 320)
SCALE = 2
GROUND = 100
BRIGHT, DARK = 220, 30
TO_WORKING = np.linalg.inv(working_to_frame(SCALE))
# A vehicle of 20 by 9 px as it is seen from a drone, and its area.
LENGTH, WIDTH = 20, 9
CAR = float(LENGTH * WIDTH)


def painted(*things, shape=SHAPE):
    """A frame with rectangles x0 y0 x1 y1 of a value each."""
    frame = np.full(shape, GROUND, np.uint8)
    for x0, y0, x1, y1, value in things:
        frame[y0:y1, x0:x1] = value
    return frame


def car(x, y, value=BRIGHT):
    """A vehicle that drives to the right."""
    return x, y, x + LENGTH, y + WIDTH, value


def coarse(frame):
    """Objects at the working scale and their foreground, a pixel too wide on each side as by hysteresis."""
    working = cv2.resize(frame, None, fx=1 / SCALE, fy=1 / SCALE, interpolation=cv2.INTER_AREA)
    mask = np.where(cv2.absdiff(working, np.full_like(working, GROUND)) > 7, 255, 0).astype(np.uint8)
    mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    return find_objects(mask, SCALE, ObjectSettings()), mask


def parts(*things, lone=(LENGTH, WIDTH)):
    """The objects of a frame, and those it is taken apart into, without twelve lone ones of a size."""
    length, width = lone
    corners = [(10 + 100 * column, 150 + 60 * row) for row in range(4) for column in range(3)]
    others = [(x, y, x + length, y + width, BRIGHT) for x, y in corners]
    frame = painted(*things, *others)
    objects, mask = coarse(frame)
    ground = np.full_like(mask, GROUND)
    split = split_objects(objects, FrameImages(frame, ground, TO_WORKING, mask, SCALE))
    return tuple(chosen(found, np.flatnonzero(found.centroids[:, 1] < 140)) for found in (objects, split))


@pytest.mark.parametrize("value", [BRIGHT, DARK])
def test_vehicles_side_by_side_are_two(value):
    """Five pixels of road between them are bridged at the working scale."""
    joined, found = parts(car(40, 40), car(46, 40 + WIDTH + 5, value))
    assert len(joined) == 1
    assert len(found) == 2
    order = np.argsort(found.boxes[:, 1])
    np.testing.assert_allclose(found.boxes[order], [[39.5, 39.5, 59.5, 48.5], [45.5, 53.5, 65.5, 62.5]])
    np.testing.assert_allclose(found.centroids[order], [[49.5, 44], [55.5, 58]])
    np.testing.assert_allclose(found.areas, CAR)
    assert found.changes.tolist() == [1.0, 1.0]


def test_an_object_of_the_usual_size_is_one():
    """The ground may show through it."""
    joined, found = parts(car(40, 40), car(46, 40 + WIDTH + 5), lone=(60, 24))
    assert len(joined) == len(found) == 1


def test_a_bright_part_next_to_a_dark_one_is_one_object():
    """From bright to dark a line is as grey as the road."""
    joined, found = parts((40, 40, 58, 49, BRIGHT), (58, 40, 59, 49, GROUND), (59, 40, 79, 49, DARK))
    assert len(joined) == len(found) == 1


def test_a_speck_beside_an_object_takes_nothing_apart():
    """A piece has a quarter of the usual area at least."""
    joined, found = parts(car(40, 40), car(60, 40), (46, 53, 50, 56, BRIGHT))
    assert len(joined) == len(found) == 1
    np.testing.assert_allclose(found.boxes, joined.boxes)


def test_what_another_object_reports_is_not_reported_twice():
    """The box of an object that is L-shaped holds another object."""
    around = (30, 30, 36, 90, BRIGHT), (30, 84, 90, 90, BRIGHT)
    joined, found = parts(*around, car(60, 40))
    assert len(joined) == len(found) == 2


def test_objects_at_the_border_are_taken_apart():
    """Boxes are clipped to the frame."""
    joined, found = parts((0, 0, 20, 9, BRIGHT), (0, 14, 20, 23, BRIGHT))
    assert (len(joined), len(found)) == (1, 2)
    assert found.boxes.min() == -0.5


def test_few_objects_have_no_usual_size():
    """Parts of the only object in view are not taken apart."""
    frame = painted(car(40, 40), car(46, 40 + WIDTH + 5), car(200, 40))
    objects, mask = coarse(frame)
    found = split_objects(objects, FrameImages(frame, np.full_like(mask, GROUND), TO_WORKING, mask, SCALE))
    assert len(objects) == len(found) == 2


def test_the_largest_object_stays_the_first():
    """Parts take their place by their own area."""
    frame = painted(
        *(car(10 + 100 * (n % 3), 120 + 50 * (n // 3)) for n in range(12)), car(40, 40), car(46, 54)
    )
    objects, mask = coarse(frame)
    found = split_objects(objects, FrameImages(frame, np.full_like(mask, GROUND), TO_WORKING, mask, SCALE))
    assert (len(objects), len(found)) == (13, 14)
    assert (np.diff(found.areas) <= 0).all()


def test_typical_area_weighs_objects_by_their_area():
    """Of many specks none counts for much."""
    assert typical_area(np.array([200.0] * 3 + [5.0] * 40 + [380.0])) == 200.0


def traffic(index):
    """Lone vehicles on some roads, two abreast on another."""
    lone = [car(10 + 4 * index + 90 * place, 20 + 40 * lane) for lane in range(3) for place in range(4)]
    abreast = [car(330 - 4 * index, 150), car(334 - 4 * index, 150 + WIDTH + 4, DARK)]
    noise = np.random.default_rng(index).normal(0, 1.5, (200, 700))
    frame = painted(*lone, *abreast, shape=(200, 700)) if index > 15 else np.full((200, 700), GROUND)
    return np.clip(np.rint(frame + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("merge_gap", "expected"), [(-1, 14), (1, 13)])
def test_vehicles_abreast_among_others(merge_gap, expected):
    """A gap that is asked for is kept to."""
    settings = DifferencerSettings(working_scale=2, objects=ObjectSettings(merge_gap=merge_gap))
    differencer = Differencer(settings)
    counts = [len(differencer.update(traffic(index), FIXED).objects) for index in range(40)]
    assert counts[25:] == [expected] * 15
