"""One frame through the differencer, on worlds with exact truth."""

import cv2
import numpy as np
import pytest
import scipy

from streamkit_differencer.canvas import CanvasChange, Motion
from streamkit_differencer.differencer import Differencer, ModelChange
from streamkit_differencer.sampling import downsampled
from streamkit_differencer.settings import BackgroundSettings, DifferencerSettings, ObjectSettings

WARM_UP = 32
MATCH_PX = 15.0


def motions(world, jitter=0.0):
    """Registrations of a world: chained from neighbours, each with errors as a stitcher makes them."""
    random = np.random.default_rng(99)
    to_reference = np.eye(3)
    for time in range(world.count):
        to_previous = world.to_previous(time)
        to_previous = to_previous + np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]) * random.normal(
            0, jitter, (3, 1)
        )
        if time == 0:
            to_previous = np.eye(3)
        to_reference = to_reference @ to_previous
        yield Motion(to_reference)


def overlap(first, second):
    """Intersection over union of two boxes."""
    low, high = np.maximum(first[:2], second[:2]), np.minimum(first[2:], second[2:])
    shared = np.prod(np.clip(high - low, 0, None))
    return shared / (np.prod(first[2:] - first[:2]) + np.prod(second[2:] - second[:2]) - shared)


class Score:
    """Objects against truth: matched within 15 px, one to one."""

    def __init__(self):
        self.hits = self.false = self.missed = 0
        self.errors, self.overlaps = [], []

    def add(self, objects, world, time):
        truth = world.truth(time)
        partly = [outline.mean(axis=0) for outline in world.outlines(time)]
        near = [min(np.linalg.norm(centre - p) for p in partly) for centre in objects.centroids]
        distance = np.array([[np.linalg.norm(c - t[0]) for t in truth] for c in objects.centroids])
        matched = set()
        if distance.size:
            for i, j in zip(*scipy.optimize.linear_sum_assignment(distance), strict=True):
                if distance[i, j] <= MATCH_PX:
                    matched.add(i)
                    self.errors.append(distance[i, j])
                    self.overlaps.append(overlap(objects.boxes[i], truth[j][1]))
        self.hits += len(matched)
        self.missed += len(truth) - len(matched)
        self.false += sum(1 for i, d in enumerate(near) if i not in matched and d > MATCH_PX)

    @property
    def f_measure(self):
        return 2 * self.hits / (2 * self.hits + self.false + self.missed)


def run(world, differencer, jitter=0.0):
    """The score of a differencer on a world, and the changes of its canvas."""
    score, changes = Score(), []
    for time, (frame, motion) in enumerate(zip(world.frames, motions(world, jitter), strict=True)):
        result = differencer.update(frame, motion if world.is_moving else None)
        changes.append(result.change)
        if time >= WARM_UP:
            score.add(result.objects, world, time)
    return score, changes


@pytest.mark.parametrize("is_moving", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", [11, 12])
def test_cars_are_found_whole_and_where_they_are(world, is_moving, seed):
    """Object F at least 0.9, centroids within 2 px and boxes that overlap the cars by 0.7 in the mean."""
    score, _ = run(world(seed, is_moving), Differencer(), jitter=0.15)
    assert score.hits > 60
    assert score.f_measure >= 0.9
    assert np.mean(score.errors) <= 2.0
    assert np.mean(score.overlaps) >= 0.7


@pytest.mark.parametrize("scale", [1, 4])
def test_other_working_scales_find_the_same_cars(world, scale):
    """Centroids and boxes stay in frame pixels at every scale; 4 is coarse for small cars."""
    score, _ = run(world(11, True), Differencer(DifferencerSettings(scale)))
    assert score.f_measure >= (0.9 if scale == 1 else 0.75)
    assert np.mean(score.errors) <= 2.0


def test_the_error_of_position_has_no_bias(world):
    """Half a pixel lost in halving or warping would show as a common shift of the centroids."""
    flight, shifts = world(11, True), []
    differencer = Differencer()
    for time, (frame, motion) in enumerate(zip(flight.frames, motions(flight), strict=True)):
        objects = differencer.update(frame, motion).objects
        for centre, box in flight.truth(time) if time >= WARM_UP else ():
            middles = (objects.boxes[:, :2] + objects.boxes[:, 2:]) / 2
            if len(objects) and np.abs(middles - centre).sum(axis=1).min() < 10:
                nearest = np.abs(middles - centre).sum(axis=1).argmin()
                shifts.append(middles[nearest] - (box[:2] + box[2:]) / 2)
    assert len(shifts) > 60
    assert np.abs(np.median(shifts, axis=0)).max() < 0.5


def test_a_flight_scrolls_the_canvas(world):
    """The moving world leaves the margin of its first canvas, so what is tested includes scrolling."""
    _, changes = run(world(11, True), Differencer())
    assert changes[0] is CanvasChange.NEW
    assert CanvasChange.SCROLL in changes


def test_without_motion_a_moving_camera_sees_motion_everywhere(world):
    """The compensation is what finds the cars: without it, object F is at least 0.2 lower."""
    flight, score = world(11, True), Score()
    differencer = Differencer()
    for time, frame in enumerate(flight.frames):
        objects = differencer.update(frame, None).objects
        if time >= WARM_UP:
            score.add(objects, flight, time)
    compensated, _ = run(flight, Differencer())
    assert score.f_measure < compensated.f_measure - 0.2


def test_nothing_is_found_where_nothing_moves(world):
    """A standing scene under a moving, jittering camera gives no objects."""
    flight = world(11, True)
    empty = type(flight)(
        21, True, count=40, cars=[flight.cars[0].__class__((-900.0, -900.0), (0.0, 1.0), 20, 0)]
    )
    differencer = Differencer()
    for frame, motion in zip(empty.frames, motions(empty, 0.15), strict=True):
        assert len(differencer.update(frame, motion).objects) == 0


def test_one_frame_gives_no_objects(world):
    """There is nothing to compare the first frame with."""
    result = Differencer().update(world(11, True).frames[0], Motion(np.eye(3)))
    assert len(result.objects) == 0
    assert result.change is CanvasChange.NEW


def test_another_frame_size_begins_a_new_model(world):
    """Frames of another size are another stream: nothing is foreground by the old background."""
    flight, differencer = world(12, False), Differencer()
    for frame in flight.frames[:30]:
        differencer.update(frame, None)
    for frame in flight.frames[30:40]:
        result = differencer.update(np.ascontiguousarray(frame[:200, :300]), None)
        assert result.foreground.shape == (200, 300)
        assert (result.foreground > 0).mean() < 0.1


def test_a_missed_frame_holds_the_model(world):
    """After frames without registration the cars are found at once: nothing was forgotten."""
    flight, differencer = world(11, True), Differencer()
    score = Score()
    for time, (frame, motion) in enumerate(zip(flight.frames, motions(flight), strict=True)):
        if 30 <= time < 34:
            continue
        result = differencer.update(frame, motion)
        if time >= 34:
            score.add(result.objects, flight, time)
    assert score.f_measure >= 0.85


def test_a_useless_registration_is_no_result(world):
    """A singular matrix does not place the frame, and the model is as it was."""
    flight, differencer = world(11, True), Differencer()
    assert differencer.update(flight.frames[0], Motion(np.zeros((3, 3)))) is None
    assert differencer.update(flight.frames[0], Motion(np.eye(3))).change is CanvasChange.NEW
    assert differencer.update(flight.frames[1], Motion(np.full((3, 3), np.nan))) is None
    assert differencer.update(flight.frames[1], Motion(flight.to_reference(1))).change is CanvasChange.NONE


def test_a_black_burst_is_held_and_forgets_nothing(world):
    """Five black frames give no result; then the cars are found at once, and nothing else."""
    flight, differencer, score = world(12, False), Differencer(), Score()
    for time, frame in enumerate(flight.frames):
        result = differencer.update(np.zeros_like(frame) if 25 <= time < 30 else frame, None)
        assert (result is None) == (25 <= time < 30)
        if time >= 30:
            assert result.event is not ModelChange.RESET
            score.add(result.objects, flight, time)
    assert score.f_measure >= 0.85


def test_a_cut_begins_the_model_anew_once(world):
    """Another scene for three frames: one reset, and no flood of objects before or after it."""
    here, there, differencer = world(12, False), world(11, False), Differencer()
    events = []
    for frame in (*here.frames[:30], *there.frames[:26]):
        result = differencer.update(frame, None)
        events.append("held" if result is None else str(result.event))
        assert result is None or len(result.objects) <= 8
    assert events.count("reset") == 1
    assert events[30:33] == ["held", "held", "reset"]


def test_a_gain_step_keeps_the_cars(world):
    """The exposure rises by a third in one frame: the model follows, the cars stay found."""
    flight, differencer, score = world(12, False), Differencer(), Score()
    for time, frame in enumerate(flight.frames):
        picture = np.clip(frame * 1.3, 0, 255).astype(np.uint8) if time >= 30 else frame
        result = differencer.update(picture, None)
        assert result.event is not ModelChange.RESET
        if time >= 30:
            score.add(result.objects, flight, time)
    assert score.f_measure >= 0.8


def test_the_same_frames_give_the_same_objects(world):
    """No chance is involved."""
    flight = world(11, True)
    for first, second in zip(*(objects_of(flight) for _ in range(2)), strict=True):
        np.testing.assert_array_equal(first.boxes, second.boxes)
        np.testing.assert_array_equal(first.centroids, second.centroids)


def objects_of(flight):
    """The objects of the first thirty frames."""
    differencer = Differencer()
    pairs = zip(flight.frames[:30], motions(flight), strict=False)
    return [differencer.update(frame, motion).objects for frame, motion in pairs]


def test_frames_are_not_written_to(world):
    """A read-only frame is no error and is as it was."""
    frame = world(12, False).frames[0].copy()
    frame.setflags(write=False)
    before = frame.copy()
    for scale in (1, 2):
        differencer = Differencer(
            DifferencerSettings(scale, BackgroundSettings(quiet_frames=2, frame_interval=1))
        )
        for _ in range(6):
            differencer.update(frame, None)
    np.testing.assert_array_equal(frame, before)


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (7, 40), (17, 33), (90, 161)])
def test_any_frame_size_works(shape):
    """Tiny and odd frames, fixed and registered, give a foreground and no error."""
    random = np.random.default_rng(5)
    for motion in (None, Motion(np.eye(3))):
        differencer = Differencer(
            DifferencerSettings(4, BackgroundSettings(quiet_frames=2, frame_interval=1))
        )
        for _ in range(6):
            assert differencer.update(random.integers(0, 255, shape, np.uint8), motion) is not None


def test_halving_averages():
    """Each working pixel is the mean of its square; an odd last row is left out."""
    image = np.arange(0, 40, 2, dtype=np.uint8).reshape(5, 4)
    assert downsampled(image, 2).tolist() == [[5, 9], [21, 25]]
    assert downsampled(image, 4).tolist() == [[15]]
    assert downsampled(image, 1) is image


@pytest.mark.parametrize("step", [1, 2, 3, 4])
def test_a_hidden_hud_is_no_evidence_that_the_camera_stands_still(step):
    """A pan that is measured here is followed under graphics that are marked as hidden."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).normal(size=(240, 420)), (0, 0), 4)
    ground = np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)
    hud = np.zeros((240, 320), np.uint8)
    for top in (16, 36, 204, 224):
        cv2.putText(hud, "ALT 1203 M  SPD 14 KT  HDG 273 N 40.1", (4, top), 0, 0.45, 255, 2)
    for left in range(20, 320, 40):
        cv2.line(hud, (left, 50), (left, 190), 255, 1)
    cv2.circle(hud, (160, 120), 30, 255, 2)
    differencer = Differencer(own_motion=True, hidden=cv2.dilate(hud, np.ones((5, 5), np.uint8)))
    views = [ground[:, step * time : step * time + 320] for time in range(24)]
    results = [differencer.update(np.where(hud > 0, hud, view), None) for view in views]
    assert None not in results
    assert np.mean([(result.foreground > 0).mean() for result in results]) < 0.01


def flight_over_a_roof(relief, frames=70):
    """Textured ground under a camera that flies 4 px a frame, and a roof that shifts by a share of that."""
    random = np.random.default_rng(5)
    ground = cv2.resize(random.integers(70, 120, (60, 240)).astype(np.uint8), (960, 240))
    for time in range(frames):
        view = ground[:, 4 * time : 4 * time + 480].copy()
        x = 460 - round(4 * time * (1 + relief))
        view[60:180, max(x, 0) : max(x + 90, 0)] = 225
        yield view, Motion(np.array([[1.0, 0, 4 * time], [0, 1, 0], [0, 0, 1]]))


@pytest.mark.parametrize(("settings", "is_reported"), [({}, False), ({"parallax": 0.2}, True)])
def test_a_tall_roof_under_a_low_flight_is_left_out(settings, is_reported):
    """It is as tall as .3 of the camera's height above it; where less is allowed, its shift is a mover."""
    differencer = Differencer(DifferencerSettings(objects=ObjectSettings(**settings)))
    found = [len(differencer.update(*given).objects) for given in flight_over_a_roof(0.3)]
    assert any(found[WARM_UP:]) == is_reported


def creeping_car(speed, frames=70):
    """A car of 20 by 9 px that creeps over a road under a camera that hovers: it moves by half a pixel."""
    random, height, width = np.random.default_rng(3), 360, 720
    road = 110 + 6 * cv2.GaussianBlur(random.normal(0, 10, (height + 40, width + 40)), (0, 0), 3)
    for time in range(frames):
        shift, place = random.uniform(-0.5, 0.5, 2), np.float32([[1, 0, 200 + speed * time], [0, 1, 180]])
        cover = cv2.warpAffine(np.ones((9, 20)), place, road.shape[::-1])
        scene = road * (1 - cover) + 50 * cover
        to_view = np.float32([[1, 0, -20 - shift[0]], [0, 1, -20 - shift[1]]])
        view = cv2.warpAffine(scene, to_view, (width, height))
        noisy = np.clip(view + random.normal(0, 1.5, view.shape), 0, 255).astype(np.uint8)
        to_reference = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])
        yield noisy, Motion(to_reference), 190 + speed * time - shift[0]


def test_a_car_that_creeps_is_found_from_a_camera_that_hovers():
    """It moves by half a pixel a frame, and no registration is a whole number of pixels."""
    differencer, found = Differencer(), []
    for image, motion, middle in creeping_car(0.5):
        left, _, right, _ = differencer.update(image, motion).objects.boxes.T
        found.append(((left < middle) & (middle < right)).any())
    assert all(found[WARM_UP + 8 :])


def test_frames_without_registration_have_no_parallax():
    """A camera that pans shows none: what moves against the pan is found as with the filter off."""
    found = []
    for parallax in (0.0, 1.0):
        settings = DifferencerSettings(objects=ObjectSettings(parallax=parallax))
        differencer = Differencer(settings, own_motion=True)
        results = [differencer.update(view, None) for view, _ in flight_over_a_roof(0.3)]
        found.append([result.objects.boxes.tolist() for result in results if result])
    assert found[0] == found[1]
    assert any(found[0])
