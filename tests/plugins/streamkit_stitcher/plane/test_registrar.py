"""Registration of a stream's frames to a plane."""

from concurrent.futures import Future
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import normalised, translation
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.plane import registrar as registrar_module
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.placement import placed
from streamkit_stitcher.plane.settings import ReferenceChoice
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import PairwiseMotion, register

SMALL = (360, 640)
BLACK = np.zeros(SMALL, np.uint8)


@pytest.fixture
def registrar(make_registrar):
    """A registrar on the plane of the first frame, to compare with the truth."""
    return make_registrar(reference=ReferenceChoice.FIRST)


@pytest.fixture(scope="module")
def flight(ground, make_flight):
    """A short flight of small frames."""
    return make_flight(ground, 400, SMALL, cars=6, laps=1.0)


def is_finite(registered):
    """Whether both matrices can be used downstream."""
    return bool(np.isfinite(registered.to_previous).all() and np.isfinite(registered.to_reference).all())


def test_drift_over_a_flight_stays_below_a_pixel(ground, make_flight, registrar):
    """720p, turning, climbing, shaking, 12 cars: the median corner error is below 0.3 px."""
    flight = make_flight(ground, 42, laps=0.32)
    registrations = [registrar.register(frame) for frame in flight.frames()]
    errors = [flight.error(registered.to_reference, index) for index, registered in enumerate(registrations)]
    steps = [
        flight.error(registered.to_previous, index, index - 1)
        for index, registered in enumerate(registrations)
        if index
    ]
    assert np.median(errors) < 0.3
    assert max(errors) < 1.0
    assert np.median(steps) < 0.15
    assert 2 < sum(registered.keyframe for registered in registrations) < 40
    assert {registered.status for registered in registrations} <= {
        RegistrationStatus.OK,
        RegistrationStatus.STILL,
    }


def test_homographies_do_not_depend_on_the_threads(ground, make_flight, monkeypatch, make_registrar):
    """Background work changes nothing but the time: the same bit for bit without it."""
    flight = make_flight(ground, 400, SMALL, cars=6, laps=4.0)
    threaded = make_registrar()
    measured = [threaded.register(flight.frame(index)).to_reference for index in range(30)]

    def at_once(self, work):
        future = Future()
        future.set_result(work())
        return future

    monkeypatch.setattr(BackgroundExecutor, "submit", at_once)
    alone = make_registrar()
    registrations = [alone.register(flight.frame(index)) for index in range(30)]
    assert sum(registered.keyframe for registered in registrations) > 2
    assert np.array_equal(measured, [registered.to_reference for registered in registrations])


def test_drift_over_a_photograph_stays_below_a_pixel(aerial_ground, make_flight, registrar):
    """The same over a real aerial frame of poor contrast: median below 1 px."""
    flight = make_flight(aerial_ground, 34, laps=0.1)
    errors = [
        flight.error(registrar.register(frame).to_reference, index)
        for index, frame in enumerate(flight.frames())
    ]
    assert np.median(errors) < 1.0
    assert max(errors) < 2.0


def test_steps_and_changes_compose_to_the_reference(flight, make_registrar):
    """Change @ previous.to_reference @ to_previous is to_reference, whatever moves the plane meanwhile."""
    registrar = make_registrar(reference=ReferenceChoice.CENTER)
    registrations = [registrar.register(flight.frame(index)) for index in range(64)]
    for before, here in pairwise(registrations):
        change = np.eye(3) if here.reference_change is None else here.reference_change
        chained = change @ before.to_reference @ here.to_previous
        assert chained / chained[2, 2] == pytest.approx(here.to_reference, abs=1e-6)
        assert here.reference == before.reference or here.reference_change is not None
    assert sum(registered.reference_change is not None for registered in registrations) > 3
    assert registrations[-1].reference >= 1


def test_the_plane_moves_to_the_middle_keyframe(flight, make_registrar):
    """When the keyframes have doubled in number, the plane is that of the one half way."""
    registrar = make_registrar(reference=ReferenceChoice.CENTER)
    keys = []
    for index in range(90):
        registered = registrar.register(flight.frame(index))
        if registered.keyframe:
            keys.append(index)
        if registered.reference == 1:
            break
    assert len(keys) == 4
    assert flight.error(registered.to_reference, index, keys[2]) < 0.5


def test_a_frame_that_its_plane_stretches_opens_a_related_plane(ground, make_flight, make_registrar):
    """A camera that descends to a fifth: the changes relate both planes."""
    flight = make_flight(ground, 60, SMALL, cars=0)
    middle = np.array([[1, 0, -319.5], [0, 1, -179.5], [0, 0, 1]])
    scales = np.geomspace(3.0, 0.6, len(flight))
    descent = replace(
        flight,
        to_ground=np.array([np.array([[s, 0, 1000], [0, s, 750], [0, 0, 1.0]]) @ middle for s in scales]),
    )
    registrar = make_registrar(reference=ReferenceChoice.FIRST)
    registrations = [registrar.register(frame) for frame in descent.frames()]
    opened = [index for index, registered in enumerate(registrations) if registered.opens_plane]
    assert len(opened) == 1
    first = registrations[opened[0]]
    assert (first.reference, first.status, first.keyframe) == (1, RegistrationStatus.OK, True)
    assert np.array_equal(first.to_reference, np.eye(3))
    old_place = np.linalg.inv(first.reference_change)
    assert descent.error(old_place / old_place[2, 2], opened[0]) < 2.0
    assert max(descent.error(item.to_previous, i, i - 1) for i, item in enumerate(registrations) if i) < 1.0
    assert descent.error(registrations[-1].to_reference, len(flight) - 1, opened[0]) < 2.0
    plane = registrar.take_plane(current=True)
    assert plane.finish() < 1.0
    assert len(plane.homographies) > 2
    plane.close()


def test_the_first_frame_is_the_plane(flight, registrar):
    """One frame alone: identity, ok, a keyframe."""
    registered = registrar.register(flight.frame(0))
    assert (registered.status, registered.keyframe, registered.reference) == (RegistrationStatus.OK, True, 0)
    assert np.array_equal(registered.to_reference, np.eye(3))
    assert np.array_equal(registered.to_previous, np.eye(3))


@pytest.mark.parametrize("level", [0, 90, 255])
def test_flat_frames_are_lost_and_the_next_good_one_is_registered(flight, registrar, level):
    """Five black or flat frames carry the motion on; the plane and its accuracy survive them."""
    for index in range(6):
        registrar.register(flight.frame(index))
    for _ in range(5):
        blind = registrar.register(np.full(SMALL, level, np.uint8))
        assert blind.status is RegistrationStatus.LOST
        assert is_finite(blind)
    found = registrar.register(flight.frame(11))
    assert (found.status, found.reference) == (RegistrationStatus.OK, 0)
    assert flight.error(found.to_reference, 11) < 0.5


def test_noise_in_the_dark_is_lost_too(flight, registrar):
    """A black frame with sensor noise has corners, but is not taken for a new scene."""
    registrar.register(flight.frame(0))
    noise = np.abs(np.random.default_rng(0).normal(0, 3, SMALL)).astype(np.uint8)
    assert registrar.register(noise).status is RegistrationStatus.LOST


def test_a_lost_frame_continues_with_the_last_velocity(ground, registrar):
    """A camera that moved 8 px a frame is expected to have moved on, for five frames and no longer."""
    for index in range(10):
        registrar.register(ground[400:760, 8 * index : 8 * index + 640])
    places = [registrar.register(BLACK).to_reference[0, 2] for _ in range(8)]
    assert np.diff(places)[:4] == pytest.approx(8.0, abs=0.5)
    assert np.diff(places)[5:] == pytest.approx(0.0)


def test_black_before_anything_is_lost(flight, registrar):
    """The plane waits for the first usable frame."""
    assert registrar.register(BLACK).status is RegistrationStatus.LOST
    first = registrar.register(flight.frame(0))
    assert (first.status, first.reference) == (RegistrationStatus.OK, 0)


def test_a_cut_opens_a_plane_and_the_next_frame_is_ok(ground, flight, registrar):
    """After a cut the number of the plane goes up and the homography is the identity."""
    for index in range(3):
        registrar.register(flight.frame(index))
    cut = registrar.register(ground[1100:1460, 60:700])
    after = registrar.register(ground[1104:1464, 64:704])
    assert (cut.status, cut.reference, after.status, after.reference) == (
        RegistrationStatus.CUT,
        1,
        RegistrationStatus.OK,
        1,
    )
    assert np.array_equal(cut.to_reference, np.eye(3))
    assert after.to_reference[:2, 2] == pytest.approx([4.0, 4.0], abs=0.1)


def test_a_step_of_the_gain_is_not_noticed(flight, registrar):
    """A frame 1.35 times as bright is registered as well as the others."""
    registrar.register(flight.frame(0))
    brighter = np.clip(flight.frame(1) * 1.35, 0, 255).astype(np.uint8)
    registered = registrar.register(brighter)
    assert registered.status is RegistrationStatus.OK
    assert flight.error(registered.to_reference, 1) < 0.5


def test_another_size_opens_a_plane(flight, registrar):
    """1280x720 to 960x540 in mid stream restarts, and is ok by the second frame."""
    registrar.register(flight.frame(0))
    small = [
        registrar.register(cv2.resize(flight.frame(index), (480, 270), interpolation=cv2.INTER_AREA))
        for index in (1, 2)
    ]
    assert [(item.status, item.reference) for item in small] == [
        (RegistrationStatus.CUT, 1),
        (RegistrationStatus.OK, 1),
    ]


@pytest.mark.parametrize("shape", [(1, 1), (2, 3000), (17, 17), (40, 40), (64, 5000)])
def test_odd_sizes_are_no_error(shape, registrar):
    """At any size noise is registered or lost with finite matrices."""
    random = np.random.default_rng(1)
    for _ in range(3):
        assert is_finite(registrar.register(random.integers(0, 255, shape, dtype=np.uint8)))


def test_a_standing_camera_is_still(flight, registrar):
    """Noise does not move the frame: still, and exactly the identity."""
    registrar.register(flight.frame(0))
    random = np.random.default_rng(0)
    for _ in range(4):
        noisy = np.clip(flight.frame(0) + random.normal(0, 2, SMALL), 0, 255).astype(np.uint8)
        registered = registrar.register(noisy)
        assert registered.status is RegistrationStatus.STILL
        assert np.array_equal(registered.to_reference, np.eye(3))
        assert np.array_equal(registered.to_previous, np.eye(3))


def test_a_slow_drift_is_not_held_for_ever(ground, registrar):
    """A camera that creeps 0.1 px a frame stays within 0.3 px of the truth."""
    wide = ground[400:770, 400:1060].astype(np.float32)
    for index in range(25):
        moved = cv2.warpAffine(
            wide, np.array([[1, 0, -0.1 * index], [0, 1, 0]]), (640, 360), flags=cv2.INTER_CUBIC
        )
        registered = registrar.register(np.clip(moved, 0, 255).astype(np.uint8))
        assert registered.to_reference[0, 2] == pytest.approx(0.1 * index, abs=0.3)


def test_skipped_frames_are_ignored(flight, registrar):
    """A corrupt frame is lost, and the next good one is registered to the one before it."""
    for index in range(4):
        registrar.register(flight.frame(index))
    assert registrar.skip().status is RegistrationStatus.LOST
    registered = registrar.register(flight.frame(5))
    assert registered.status is RegistrationStatus.OK
    assert flight.error(registered.to_reference, 5) < 0.5


def test_a_restart_opens_a_plane(flight, registrar):
    """Nothing relates what comes after a restart to what was before."""
    registrar.restart()
    assert registrar.register(flight.frame(0)).reference == 0
    registrar.restart()
    registered = registrar.register(flight.frame(1))
    assert (registered.reference, registered.status) == (1, RegistrationStatus.CUT)
    assert np.array_equal(registered.to_previous, np.eye(3))


def test_unplaceable_frames_open_a_plane_in_the_end(flight, ground, registrar):
    """A frame that fits nowhere after a dark spell starts again instead of staying lost."""
    registrar.register(flight.frame(0))
    registrar.register(BLACK)
    registrations = [registrar.register(ground[1100:1460, 60:700]) for _ in range(30)]
    assert registrations[-1].reference == 1
    assert registrations[-1].status in {RegistrationStatus.OK, RegistrationStatus.STILL}


def test_the_same_frames_give_the_same_homographies(flight, make_registrar):
    """Two runs agree bit for bit."""
    runs = []
    for _ in range(2):
        registrar = make_registrar()
        runs.append([registrar.register(flight.frame(index)).to_reference for index in range(0, 60, 4)])
    assert np.array_equal(runs[0], runs[1])


@pytest.mark.parametrize(("shake_px", "least"), [(0.0, 14), (5.0, 0)])
def test_interlaced_frames_are_ok_where_the_camera_moves_evenly(
    ground, make_flight, registrar, shake_px, least
):
    """A frame is right between its two moments; where its fields jump apart there is none, and it is weak."""
    shape, random = (360, 640), np.random.default_rng(4)
    places = (
        np.array([600.0, 500.0]) + np.outer(np.arange(32), [3.0, 1.0]) + random.normal(0, shake_px, (32, 2))
    )
    fields = replace(make_flight(ground, 32, shape, cars=0), to_ground=np.array([*map(translation, places)]))
    middles = replace(fields, to_ground=np.array([*map(translation, (places[::2] + places[1::2]) / 2)]))
    found = []
    for index in range(len(middles)):
        frame = fields.frame(2 * index)
        frame[1::2] = fields.frame(2 * index + 1)[1::2]
        found.append(registrar.register(frame))
    called = [index for index in range(1, len(found)) if found[index].status is RegistrationStatus.OK]
    assert len(called) >= least
    assert all(middles.error(found[index].to_reference, index) < 2.0 for index in called)
    assert shake_px == 0 or len(called) < 4


def test_frames_of_unknown_place_start_a_plane_once_they_continue_each_other(
    ground, make_flight, registrar, monkeypatch
):
    """At a cut that is not noticed, where corners of both scenes agree by chance, few frames are weak.

    So is the one after the cut, which may show the same leaves.
    """
    shape, first = (360, 640), 15
    there = [translation(np.array([200.0 + 8 * index, 320.0])) for index in range(first)]
    elsewhere = [translation(np.array([1200.0, 1000.0 - 6 * index])) for index in range(20)]
    to_ground = np.array([*there, *elsewhere])
    flight = replace(make_flight(ground, len(to_ground), shape, cars=0), to_ground=to_ground)
    chance = PairwiseMotion(translation(np.array([300.0, 0.0])), MotionModel.HOMOGRAPHY, False, 100, 40, 1.0)
    found = []

    def measured(*arguments):
        return chance if len(found) == first else register(*arguments)

    monkeypatch.setattr(registrar_module, "register", measured)
    for frame in flight.frames():
        found.append(registrar.register(frame))
    states = [item.status.value for item in found[first:]]
    assert states == ["weak"] * 3 + ["cut", "weak"] + ["ok"] * 15
    assert [found[index].reference for index in (0, first, first + 3, -1)] == [0, 0, 1, 1]
    step = np.linalg.inv(found[first + 3].to_reference) @ found[-1].to_reference
    assert flight.error(normalised(step), len(flight) - 1, first + 3) < 1.0


def test_a_frame_is_as_certain_as_the_one_before_it_allows(ground, registrar, monkeypatch):
    """Two frames that are known to 1 px each, against one keyframe, are ok; one after a worse one is not."""
    predicted, match_near = iter([0.9, 0.9, 1.1, 0.3, 0.9]), KeyframeAnchor.match_near

    def with_error(self, *arguments):
        return replace(match_near(self, *arguments), corner_std=next(predicted))

    monkeypatch.setattr(KeyframeAnchor, "match_near", with_error)
    frames = [ground[400:760, left : left + 640] for left in range(300, 318, 3)]
    states = [registrar.register(np.ascontiguousarray(frame)).status.value for frame in frames]
    assert states == ["ok", "ok", "ok", "weak", "weak", "ok"]


def test_corners_that_only_confirm_a_weak_match_are_tracked_in_every_fourth_frame(
    ground, registrar, monkeypatch
):
    """After eight frames, so that a live stream over relief does not fall behind; all keep their match."""
    match_near, tracked, is_weak = KeyframeAnchor.match_near, [], False

    def weakly(self, *arguments):
        match = match_near(self, *arguments)
        return replace(match, share=0.1, corner_std=3.0) if is_weak else match

    def confirmed(self, images, near, *_):
        return placed(self.keyframes.active, near)

    def counted(*arguments):
        tracked.append(number)
        return register(*arguments)

    monkeypatch.setattr(KeyframeAnchor, "match_near", weakly)
    monkeypatch.setattr(KeyframeAnchor, "place", confirmed)
    monkeypatch.setattr(registrar_module, "register", counted)
    for number in range(24):
        is_weak = number >= 4 and number != 20
        left = 300 + 3 * number
        assert registrar.register(np.ascontiguousarray(ground[400:760, left : left + 640])).measured
    assert tracked == [*range(4, 12), 15, 19, 21, 22, 23]
