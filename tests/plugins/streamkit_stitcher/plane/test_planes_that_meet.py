"""Planes that meet again."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from streamkit.geometry.homography import normalised, translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.settings import ReferenceChoice

pytestmark = pytest.mark.long
SHAPE = (450, 640)
# A row of photographs, 300 px apart.
PLACES = [(200 + 300 * number, 300) for number in range(8)]


def looking(place, lean, shape):
    """The homography of a camera at x y, whose far side is 1 + `lean` times as deep as the middle."""
    height, width = shape
    to_middle = translation(-np.array([width - 1, height - 1]) / 2)
    leaning = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, lean / (height / 2), 1.0]])
    return normalised(translation(np.asarray(place, dtype=np.float64)) @ leaning @ to_middle)


def looking_up_and_down(count, shape):
    """Homographies to the ground of a camera whose far side is up to 1.4 times as deep as the middle."""
    index = np.arange(count)
    tilts = np.interp(index, [0, count / 3, 2 * count / 3, count], [0.0, 0.38, 0.38, 0.28])
    ways = 900 - 4.0 * np.maximum(0, index - 0.4 * count)
    return np.array([looking((1000.0, way), tilt, shape) for tilt, way in zip(tilts, ways, strict=True)])


def registered(ground, registrar, order):
    """The registrations of the photographs in some order."""
    frames = [ground[y : y + SHAPE[0], x : x + SHAPE[1]] for x, y in PLACES]
    return [registrar.register(frames[number]) for number in order]


@pytest.mark.parametrize(
    "order", [(0, 1, 5, 6, 3, 2, 4), (6, 0, 3, 1, 5, 2, 4), (0, 6, 5, 1, 4, 3, 2)], ids=str
)
def test_planes_that_a_photograph_connects_become_one(aerial_ground, make_registrar, order):
    """In any order all photographs lie on one plane in the end, where they should to a pixel."""
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    found = registered(aerial_ground, registrar, order)
    assert any(item.status is RegistrationStatus.CUT for item in found)
    plane = registrar.take_plane(current=True)
    plane.finish()
    (homographies,) = plane.planes.values()
    assert len(homographies) == len(order)
    to_first = np.linalg.inv(homographies[0])
    for index, number in enumerate(order):
        step = normalised(to_first @ homographies[index])[:2, 2]
        assert step == pytest.approx([300.0 * (number - order[0]), 0.0], abs=1.5)
    plane.close()


def test_the_change_of_a_joined_plane_relates_its_frames(aerial_ground, make_registrar):
    """From one frame to the next `change @ previous @ to_previous` is the new homography, but at a cut."""
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    found = registered(aerial_ground, registrar, (0, 1, 2, 3, 6, 5, 4, 7))
    assert [item.reference for item in found] == [0, 0, 0, 0, 1, 1, 1, 0]
    assert found[-1].reference_change is not None
    assert found[-1].status is not RegistrationStatus.CUT
    for before, after in pairwise(found):
        if after.status is not RegistrationStatus.CUT:
            change = np.eye(3) if after.reference_change is None else after.reference_change
            expected = normalised(change @ before.to_reference @ after.to_previous)
            assert expected == pytest.approx(after.to_reference, abs=1e-6)


def test_a_plane_that_is_met_again_continues(aerial_ground, make_registrar):
    """A photograph of an earlier plane is a cut to that plane, with its number."""
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    first, _, elsewhere, back = registered(aerial_ground, registrar, (0, 1, 5, 2))
    assert (first.reference, elsewhere.reference, elsewhere.status) == (0, 1, RegistrationStatus.CUT)
    assert (back.reference, back.status, back.measured, back.reference_change) == (
        0,
        RegistrationStatus.CUT,
        True,
        None,
    )


def test_a_kept_plane_is_met_again_when_planes_are_kept_no_longer(aerial_ground, make_registrar):
    """What is kept stays until a new plane begins, with which all end."""
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    registered(aerial_ground, registrar, (0, 1, 5))
    registrar.keep_planes(False)
    (back,) = registered(aerial_ground, registrar, (2,))
    assert (back.reference, back.status, back.measured) == (0, RegistrationStatus.CUT, True)
    assert registrar.take_plane() is None
    registrar.restart()
    plane = registrar.take_plane()
    assert list(plane.planes) == [0, 1]
    plane.close()


def test_a_plane_that_another_stretches_is_not_joined_to_it_by_a_similarity(
    ground, make_flight, make_registrar
):
    """A camera that looks up, flies on and down a little: each frame is where it should be on its plane."""
    count, shape = 90, (360, 640)
    flight = replace(make_flight(ground, count, shape, cars=0), to_ground=looking_up_and_down(count, shape))
    registrar = make_registrar(reference=ReferenceChoice.FIRST, keyframe_overlap=0.9)
    starts = {}
    for index, frame in enumerate(flight.frames()):
        found = registrar.register(frame)
        start, place = starts.setdefault(found.reference, (index, found.to_reference))
        on_first = normalised(np.linalg.inv(place) @ found.to_reference)
        assert found.status in {RegistrationStatus.OK, RegistrationStatus.STILL}
        assert flight.error(on_first, index, start) < 2.0
    assert list(starts) == [0, 1]


@pytest.mark.parametrize(("lean", "last"), [(0.0, 0), (-0.1, 0)])
def test_a_video_joins_planes_only_where_that_puts_its_frames_right(
    ground, make_flight, make_registrar, lean, last
):
    """A video shows a road, then something else, then the road from aside, at the same tilt or another.

    At first only a strip along one edge shows both, which says little of the other side of the frame.
    """
    shape, first, other = (360, 640), 52, 6
    there = [looking((600.0 + 15 * index, 500.0), 0.0, shape) for index in range(first)]
    back = [looking((1000.0, 1000.0 - 10 * index), lean, shape) for index in range(50)]
    to_ground = np.array([*there, *there[:other], *back])
    flight = replace(make_flight(ground, len(to_ground), shape, cars=0), to_ground=to_ground)
    elsewhere = replace(flight, ground=np.ascontiguousarray(ground[:, ::-1]))
    registrar = make_registrar(reference=ReferenceChoice.FIRST, keyframe_overlap=0.9)
    found = []
    for index in range(len(flight)):
        shown = elsewhere if first <= index < first + other else flight
        found.append(registrar.register(shown.frame(index)))
    start = first + other
    assert [found[index].reference for index in (0, first, start, -1)] == [0, 1, 2, last]
    for index in range(start + 1, len(found)):
        began = start if found[index].reference == 2 else 0
        step = normalised(np.linalg.inv(found[began].to_reference) @ found[index].to_reference)
        assert found[index].status is RegistrationStatus.OK
        assert flight.error(step, index, began) < 2.0
