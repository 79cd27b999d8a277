"""Loop closure, and photographs."""

from functools import partial

import cv2
import numpy as np

from streamkit.geometry.homography import IDENTITY, translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.keyframe_content import keyframe_content
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.plane.loop_closure import correlation
from streamkit_stitcher.plane.settings import ReferenceChoice

SHAPE = (450, 640)


def views(ground, places):
    """Photographs of a ground, and where they lie in it."""
    return [ground[y : y + SHAPE[0], x : x + SHAPE[1]] for x, y in places]


def test_photographs_with_half_overlap_are_registered(aerial_ground, make_registrar):
    """Strips there and back: every photograph is registered to a pixel, and the strips are tied together."""
    places = [(200 + 300 * n, 300) for n in range(4)] + [(1100 - 300 * n, 560) for n in range(4)]
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    for frame, (x, y) in zip(views(aerial_ground, places), places, strict=True):
        registered = registrar.register(frame)
        assert registered.status is RegistrationStatus.OK
        assert registered.keyframe
        assert (
            np.abs(registered.to_reference - translation(np.array([x - 200.0, y - 300.0])))[:2, 2].max() < 2.0
        )
    plane = registrar.take_plane(current=True)
    assert plane.finish() < 0.5
    assert any(host < 3 for own in (5, 6, 7) for host in plane.tied_to(own))
    first = plane.homographies[0]
    for index, (x, y) in enumerate(places):
        found = np.linalg.inv(first) @ plane.homographies[index]
        assert np.abs(found / found[2, 2] - translation(np.array([x - 200.0, y - 300.0])))[:2, 2].max() < 1.0
    plane.close()


def over_relief(ground, x, y):
    """A photograph of uneven ground, whose heights shift it by several px away from the middle."""
    heights = cv2.resize(
        np.random.default_rng(1).normal(size=(40, 52)).astype(np.float32),
        ground.shape[::-1],
        interpolation=cv2.INTER_CUBIC,
    )
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    across, down = columns - SHAPE[1] / 2, rows - SHAPE[0] / 2
    shift = 0.02 * heights[y : y + SHAPE[0], x : x + SHAPE[1]]
    return cv2.remap(ground, x + columns - shift * across, y + rows - shift * down, cv2.INTER_LINEAR)


def test_photographs_over_relief_are_keyframes_however_alike_they_are(aerial_ground, make_registrar):
    """A row of which most are as alike as frames of a video: each is tied to the one before it."""
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    found = [registrar.register(over_relief(aerial_ground, 200 + 200 * number, 300)) for number in range(6)]
    assert all(one.keyframe for one in found)
    plane = registrar.take_plane(current=True)
    plane.finish()
    places = [plane.homographies[one.key_index] @ one.to_key for one in found]
    plane.close()
    middle = np.array([SHAPE[1] / 2, SHAPE[0] / 2, 1.0])
    across = [(place @ middle)[0] / (place @ middle)[2] for place in places]
    # The ground is not flat, the plane is: each step is a little longer.
    assert all(190.0 < step < 240.0 for step in np.diff(across))


def test_a_photograph_of_elsewhere_is_a_cut(aerial_ground, make_registrar):
    """Without common ground nothing is tied: the plane is another."""
    registrar = make_registrar()
    first, second = views(aerial_ground, [(100, 100), (2200, 1700)])
    registrar.register(first)
    assert registrar.register(second).status is RegistrationStatus.CUT


def test_frames_correlate_at_their_true_shift_only(ground):
    """In other light, at another scale and a pixel off, too; with nothing in common there is no likeness."""
    one, other = (
        Keyframe(0, IDENTITY, SHAPE, 1, partial(keyframe_content, (frame,), 0))
        for frame in (ground[200:650, 300:940], (ground[300:750, 600:1240] * 0.7).astype(np.uint8))
    )
    shift = np.array([-300.0, -100.0])
    assert correlation(one, other, translation(shift)) > 0.95
    assert correlation(one, other, translation(shift + 1.0)) > 0.8
    assert abs(correlation(one, other, translation(shift + 60.0))) < 0.3
    assert correlation(one, other, translation(np.array([900.0, 0.0]))) == 0.0
