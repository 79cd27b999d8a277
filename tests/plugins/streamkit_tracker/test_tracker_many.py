"""Many targets on simulated detections that miss, lie and merge."""

from collections.abc import Iterator
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import scipy

from streamkit.geometry.track import Track, TrackState
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker

MATCH_PX = 10.0


def observe(seen) -> Observation:
    """A simulated frame as the tracker gets it."""
    return Observation(
        0.04,
        to_previous=seen.to_previous,
        to_reference=seen.to_reference,
        centroids=seen.centroids,
        boxes=seen.boxes,
    )


def follow(flight, settings: TrackerSettings | None = None):
    """Truth and reports of every frame."""
    tracker = MultiTargetTracker(settings)
    return [(seen, tracker.step(seen.image, observe(seen))) for seen in flight]


def confirmed(reports: tuple[Track, ...]) -> list[Track]:
    """The confirmed ones."""
    return [report for report in reports if report.state is TrackState.CONFIRMED]


def matches(rows):
    """(frame, car, report) of confirmed reports within 10 px of a car, and how many were false."""
    found, false = [], 0
    for index, (seen, reports) in enumerate(rows):
        tracks, cars = confirmed(reports), list(seen.truth.items())
        gaps = np.array([[np.hypot(*(t.turned_box[:2] - w[:2])) for t in tracks] for _, w in cars])
        gaps = gaps.reshape(len(cars), len(tracks))
        pairs = [
            p
            for p in zip(*scipy.optimize.linear_sum_assignment(np.minimum(gaps, 50)), strict=True)
            if gaps[p] < MATCH_PX
        ]
        found += [(index, cars[row][0], tracks[column]) for row, column in pairs]
        false += len(tracks) - len(pairs)
    return found, false


def some_cars(scenes: ModuleType, seed: int, count: int):
    """Cars of any direction at 30 to 110 px/s."""
    generator = np.random.default_rng(seed)
    cars = []
    for _ in range(count):
        speed, angle = generator.uniform(30, 110), generator.uniform(0, 2 * np.pi)
        start = (generator.uniform(60, 480), generator.uniform(60, 360))
        velocity = (speed * np.cos(angle), speed * np.sin(angle))
        cars.append(scenes.Car(start, velocity, scenes.car_texture(generator)))
    return cars


@pytest.mark.parametrize("seed", [0, 3])
def test_cars_under_a_moving_camera_are_followed(scenes: ModuleType, seed: int):
    """Recall 0.9, at most one false track in ten frames, 3 px, one id each."""
    flight = scenes.Flight(some_cars(scenes, seed, 6), frames=70, seed=seed)
    rows = follow(flight)
    found, false = matches(rows)
    total = sum(len(seen.truth) for seen, _ in rows)
    error = [
        np.hypot(*(report.turned_box[:2] - rows[index][0].truth[car][:2])) for index, car, report in found
    ]
    assert len(found) >= 0.9 * total
    assert false <= 0.1 * len(rows)
    assert np.percentile(error, 95) <= 3.0
    ids = {car: {report.id for _, c, report in found if c == car} for _, car, _ in found}
    assert sum(len(of_car) for of_car in ids.values()) <= len(ids) + 1


@pytest.mark.parametrize(("budget_ms", "least", "most"), [(0.0, 0.35, 0.6), (1e-6, 0.1, 0.35)])
def test_detected_targets_are_looked_at_in_turn(
    scenes: ModuleType, budget_ms: float, least: float, most: float
):
    """Also with no time at all: detections keep targets in place; all stay followed, under one id."""
    flight = scenes.Flight(some_cars(scenes, 0, 6), frames=70, seed=0)
    rows = follow(flight, TrackerSettings(budget_ms=budget_ms))
    found, false = matches(rows)
    assert len(found) >= 0.85 * sum(len(seen.truth) for seen, _ in rows)
    assert false <= 0.1 * len(rows)
    ids = {car: {report.id for _, c, report in found if c == car} for _, car, _ in found}
    assert sum(len(of_car) for of_car in ids.values()) <= len(ids) + 1
    late = [
        report.provenance for index, _, report in found if index >= 30 and report.provenance.gate is not None
    ]
    looked_at = sum(provenance.similarity is not None for provenance in late)
    assert least * len(late) < looked_at < most * len(late)


def test_velocity_is_that_over_the_ground(scenes: ModuleType):
    """px/s on the reference plane, without the camera's own motion."""
    car = scenes.Car((150, 120), (70, 30), scenes.car_texture(np.random.default_rng(1)))
    rows = follow(scenes.Flight([car], frames=40, seed=2, false_alarms=0))
    (report,) = confirmed(rows[-1][1])
    np.testing.assert_allclose(report.velocity, [70, 30], atol=6)


def test_shape_and_heading_come_from_box_and_motion(scenes: ModuleType):
    """Length along the motion, within a fifth; the angle within 6 degrees."""
    car = scenes.Car((150, 120), (60, 55), scenes.car_texture(np.random.default_rng(1)))
    rows = follow(scenes.Flight([car], frames=40, seed=4, false_alarms=0, box_noise=1.0))
    (report,) = confirmed(rows[-1][1])
    truth = rows[-1][0].truth[0]
    assert report.turned_box[2] == pytest.approx(truth[2], rel=0.2)
    assert report.turned_box[3] == pytest.approx(truth[3], rel=0.25)
    assert abs(np.degrees((report.turned_box[4] - truth[4] + np.pi / 2) % np.pi - np.pi / 2)) < 6


def test_crossing_cars_keep_their_ids(scenes: ModuleType):
    """Two cars that drive over each other's path, one blob meanwhile, go on under their own numbers."""
    textures = [scenes.car_texture(np.random.default_rng(seed)) for seed in (21, 22)]
    cars = [scenes.Car((100, 200), (80, 0), textures[0]), scenes.Car((180, 118), (0, 80), textures[1])]
    flight = scenes.Flight(cars, frames=60, seed=5, merged_within=35, camera=(0.5, 0.2), false_alarms=0)
    found, _ = matches(follow(flight))
    for car in (0, 1):
        ids = [report.id for _, number, report in found if number == car]
        assert ids[0] == ids[-1]
        assert len(set(ids)) == 1


def test_a_stopped_car_coasts_and_then_ends(scenes: ModuleType):
    """Undetected it stays for a second at least on its appearance, as coasting, but not for ever."""
    car = scenes.Car((100, 100), (70, 20), scenes.car_texture(np.random.default_rng(3)), stops_at=50)
    rows = follow(
        scenes.Flight([car], frames=130, seed=3, miss=0.0, false_alarms=0),
        TrackerSettings(coast=2.0),
    )
    states = [[report.state for report in reports] for _, reports in rows]
    undetected = 61
    assert states[undetected + 15] == [TrackState.COASTING]
    assert states[-1] == []
    assert sum(state == [TrackState.LOST] for state in states) == 1


def test_what_blinks_in_place_is_never_confirmed(scenes: ModuleType):
    """A ghost that is detected at one place of the ground at every frame does not travel: no track."""
    flight = scenes.Flight([], frames=40, seed=1, ghosts=[(200, 150, 3, 40)], false_alarms=0)
    assert all(not confirmed(reports) for _, reports in follow(flight))


def test_a_car_that_vanishes_leaves_no_ghost(scenes: ModuleType):
    """Where there is only ground left, nothing is confirmed after five frames, and the track ends."""
    car = scenes.Car((100, 100), (70, 20), scenes.car_texture(np.random.default_rng(3)), gone_at=40)
    settings = TrackerSettings(coast=0.8)
    rows = follow(scenes.Flight([car], frames=70, seed=3, miss=0.0, false_alarms=0), settings)
    assert len(confirmed(rows[39][1])) == 1
    assert all(not confirmed(reports) for _, reports in rows[46:])
    states = [report.state for _, reports in rows[40:] for report in reports]
    assert states.count(TrackState.LOST) == 1
    assert rows[-1][1] == ()


def test_doubt_grows_while_nothing_is_seen(scenes: ModuleType):
    """A coasting target's covariance grows from frame to frame; it is reported only while it is of use."""
    car = scenes.Car((100, 100), (70, 20), scenes.car_texture(np.random.default_rng(3)), gone_at=40)
    rows = follow(scenes.Flight([car], frames=70, seed=3, miss=0.0, false_alarms=0))
    coasting = [report for _, reports in rows for report in reports if report.state is TrackState.COASTING]
    spread = [np.trace(report.covariance) for report in coasting]
    assert len(spread) >= 5
    assert all(later > earlier for earlier, later in pairwise(spread))
    assert max(np.sqrt(report.covariance[0, 0]) for report in coasting) < coasting[0].turned_box[2]


@pytest.mark.parametrize("unseen", [12, 24])
def test_an_identity_survives_a_gap(scenes: ModuleType, unseen: int):
    """A car under a roof for half a second or a whole one comes out under the number it had."""
    car = scenes.Car((80, 120), (80, 10), scenes.car_texture(np.random.default_rng(9)))
    tracker = MultiTargetTracker(TrackerSettings(coast=2.0))
    roof = scenes.ground(np.random.default_rng(4), 360, 480).astype(np.uint8)
    ids = []
    for index, seen in enumerate(scenes.Flight([car], frames=75, seed=7, miss=0.0, false_alarms=0)):
        covered = 40 <= index < 40 + unseen
        none = Observation(0.04, to_previous=seen.to_previous, to_reference=seen.to_reference)
        reports = tracker.step(roof if covered else seen.image, none if covered else observe(seen))
        ids.append([report.id for report in confirmed(reports)])
    assert ids[39] == [1]
    assert ids[39 + unseen] == []
    assert ids[-1] == [1]


def test_two_targets_on_one_object_become_the_older_one(scenes: ModuleType):
    """A second target started on a tracked car ends; the older number stays."""
    car = scenes.Car((100, 100), (60, 10), scenes.car_texture(np.random.default_rng(5)))
    tracker = MultiTargetTracker()
    for index, seen in enumerate(scenes.Flight([car], frames=30, seed=6, miss=0.0, false_alarms=0)):
        reports = tracker.step(seen.image, observe(seen))
        if index == 20:
            (first,) = confirmed(reports)
            tracker.start_target(seen.image, seen.truth[0], observe(seen))
    assert [report.id for report in reports] == [first.id]


def test_the_number_of_targets_is_bounded():
    """However many detections come, confirmed and tentative targets stay within their limits."""
    settings = TrackerSettings(max_targets=3)
    tracker = MultiTargetTracker(settings)
    image = np.random.default_rng(0).integers(0, 255, (200, 300)).astype(np.uint8)
    columns, rows = np.meshgrid(np.arange(20.0, 280, 26), np.arange(20.0, 180, 26))
    start = np.column_stack([columns.ravel(), rows.ravel()])
    for index in range(8):
        centroids = start + np.array([2.5 * index, 0])
        boxes = np.hstack([centroids - 6, centroids + 6])
        reports = tracker.step(image, Observation(0.04, centroids=centroids, boxes=boxes))
        assert len(confirmed(reports)) <= 3
        assert len(reports) <= 15


def test_who_coasts_makes_room_for_who_is_seen():
    """With the places taken, a new mover takes that of a coasting one, which ends and is counted."""
    tracker = MultiTargetTracker(TrackerSettings(max_targets=1, lost_threshold=0.0))
    noise = np.random.default_rng(0)
    ground = noise.integers(90, 110, (200, 300)).astype(np.uint8)
    body = noise.integers(0, 255, (12, 12)).astype(np.uint8)

    def step(place: tuple[float, float]) -> dict[int, TrackState]:
        image = ground.copy()
        left, top = round(place[0]) - 6, round(place[1]) - 6
        image[top : top + 12, left : left + 12] = body
        centroids = np.array([place])
        boxes = np.hstack([centroids - 6, centroids + 6])
        reports = tracker.step(image, Observation(0.04, centroids=centroids, boxes=boxes))
        return {report.id: report.state for report in reports}

    for index in range(60):
        step((40.0 + 2.5 * index, 40.0))
    states = [step((40.0 + 2.5 * index, 160.0)) for index in range(8)]
    assert TrackState.LOST in [found.get(1) for found in states]
    assert tracker.evicted == 1
    assert any(found.get(2) is TrackState.CONFIRMED for found in states)
    assert all(list(found.values()).count(TrackState.CONFIRMED) <= 1 for found in states)


def test_ids_are_never_used_again(scenes: ModuleType):
    """A number that was lost does not come back."""
    rows = follow(scenes.Flight(some_cars(scenes, 2, 3), frames=40, seed=2, miss=0.3, false_alarms=3))
    gone: set[int] = set()
    for _, reports in rows:
        assert not gone & {report.id for report in reports}
        gone |= {report.id for report in reports if report.state is TrackState.LOST}


def test_broken_detections_are_left_out(scenes: ModuleType):
    """NaN centroids, empty and inverted boxes start nothing and break nothing."""
    centroids = np.array([[np.nan, 5.0], [20.0, 20.0], [30.0, 30.0], [40.0, np.inf]])
    boxes = np.array([[0, 0, 9, 9], [20, 20, 20, 20], [35, 35, 25, 25], [1.0, 2, 3, 4]])
    tracker = MultiTargetTracker()
    image = np.zeros((60, 60), np.uint8)
    for _ in range(5):
        assert tracker.step(image, Observation(0.04, centroids=centroids, boxes=boxes)) == ()


def test_features_decide_between_detections_that_lie_alike():
    """Two detections at the same distance: the target takes the one whose vector is its own."""
    image = np.zeros((100, 100), np.uint8)
    tracker = MultiTargetTracker()
    own, other = np.array([1.0, 0.0], np.float32), np.array([-1.0, 0.0], np.float32)

    def step(places: list[tuple[float, float]], vectors: list[np.ndarray]) -> tuple[Track, ...]:
        centroids = np.array(places)
        boxes = np.hstack([centroids - 5, centroids + 5])
        return tracker.step(
            image,
            Observation(
                0.04, centroids=centroids, boxes=boxes, features=np.stack(vectors), features_version=1
            ),
        )

    step([(50.0, 50.0)], [own])
    step([(50.0, 50.0)], [own])
    reports = step([(53.0, 50.0), (47.0, 50.0)], [other, own])
    assert reports[0].turned_box[0] < 49.5


@pytest.mark.parametrize("jacket", [210, 90])
def test_an_object_covered_by_another_does_not_give_it_its_id(jacket: int):
    """One person stops behind another, whose box then lies where the first one's is expected.

    The newcomer looks like the first one, and takes the id as far as boxes can tell; or unlike it.
    """
    tracker, numbers = MultiTargetTracker(), []
    for index in range(40):
        is_covered = index >= 20
        left = 40.0 + 2 * index + 4 * is_covered
        box = np.array([[left, 30, left + 20, 90]])
        red = np.full((60, 100), 128, np.uint8)
        red[15:30, int(left / 2) : int(left / 2) + 10] = jacket if is_covered else 210
        reports = tracker.step(
            np.full((120, 200), 100, np.uint8),
            Observation(
                0.04,
                chroma=(np.full((60, 100), 128, np.uint8), red),
                centroids=(box[:, :2] + box[:, 2:]) / 2,
                boxes=box,
                scores=np.ones(1),
                are_objects=True,
            ),
        )
        numbers.append([report.id for report in confirmed(reports)])
    assert numbers[10:20] == [[1]] * 10
    assert numbers[-1] == ([1] if jacket == 210 else [2])


def test_objects_that_show_noise_keep_their_ids():
    """What differs from itself in every frame is not too unlike: twenty boxes over noise, each one target."""
    generator, tracker = np.random.default_rng(0), MultiTargetTracker()
    starts = np.column_stack([np.tile(np.arange(5) * 60 + 30, 4), np.repeat(np.arange(4) * 70 + 40, 5)])
    for index in range(40):
        image = generator.integers(0, 255, (300, 400)).astype(np.uint8)
        u, v = generator.integers(0, 255, (2, 150, 200)).astype(np.uint8)
        centroids, half = starts + np.array([1.0 * index, 0.0]), np.array([15, 25])
        boxes = np.hstack([centroids - half, centroids + half])
        reports = tracker.step(
            image,
            Observation(
                0.04,
                chroma=(u, v),
                centroids=centroids,
                boxes=boxes,
                scores=np.ones(20),
                are_objects=True,
            ),
        )
    assert [report.id for report in confirmed(reports)] == list(range(1, 21))


def large_and_part(index: int, *, with_large: bool) -> Observation:
    """A region of 40x100 px whose centre of mass lies low, and one of 12x10 px within it; both move."""
    boxes = np.array([[60.0, 90, 72, 100], [50, 40, 90, 140]]) + 2 * index * np.array([1, 0, 1, 0])
    centroids = (boxes[:, :2] + boxes[:, 2:]) / 2 + [[0, 0], [3, 20]]
    return Observation(0.04, centroids=centroids[: 1 + with_large], boxes=boxes[: 1 + with_large])


def test_a_large_region_starts_a_target_where_a_part_of_it_is_followed():
    """A part was seen first; the whole is another target, not a duplicate of its part."""
    tracker, image = MultiTargetTracker(), np.zeros((200, 400), np.uint8)
    for index in range(60):
        reports = tracker.step(image, large_and_part(index, with_large=index >= 20))
    part, whole = reports
    assert (part.id, whole.id, whole.state) == (1, 2, TrackState.CONFIRMED)
    np.testing.assert_allclose(whole.turned_box, [70 + 2 * 59, 90, 40, 100, 0], atol=0.01)


def walkers(index: int) -> Observation:
    """Two people of 24x60 px who walk towards each other, one region while they are closer than 4 px."""
    boxes = np.array([[60.0, 60, 84, 120], [260, 70, 284, 130]]) + 2 * index * np.array(
        [[1, 0, 1, 0], [-1, 0, -1, 0]]
    )
    if abs(boxes[1, 0] - boxes[0, 0]) < 28:
        boxes = np.hstack([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])[None]
    return Observation(0.04, centroids=(boxes[:, :2] + boxes[:, 2:]) / 2, boxes=boxes)


def test_people_keep_their_ids_and_sizes_in_a_region_that_shows_both():
    """They cross in it, each where it would be without the other; they come out of it as they went in."""
    tracker, image = MultiTargetTracker(), np.zeros((200, 400), np.uint8)
    for index in range(80):
        reports = tracker.step(image, walkers(index))
        if 44 <= index < 48:
            assert [report.provenance.shared for report in reports] == [True, True]
            assert [report.state for report in reports] == [TrackState.COASTING] * 2
            np.testing.assert_allclose(
                [report.turned_box[0] for report in reports], [72 + 2 * index, 272 - 2 * index], atol=2
            )
            np.testing.assert_allclose(
                [report.turned_box[2:] for report in reports], [[24, 60, 0]] * 2, atol=1
            )
    assert [(report.id, report.state) for report in reports] == [(1, "confirmed"), (2, "confirmed")]
    np.testing.assert_allclose([report.turned_box[0] for report in reports], [72 + 158, 272 - 158], atol=1)


def one_region(index: int, speed: float, score: float, growth: float, **observed: bool) -> Observation:
    """What comes with frame `index`: a region that moves, px a frame; every second box is larger."""
    x, scale = 40.0 + speed * index, growth if index % 2 else 1.0
    return Observation(
        0.04,
        centroids=np.array([[x, 50.0]]),
        boxes=np.array([[x, 50, x, 50]]) + scale * np.array([-12.0, -6.0, 12.0, 6.0]),
        scores=np.array([score]),
        **observed,
    )


def first_confirmations(
    settings: TrackerSettings, speed: float, score: float, growth: float, **observed: bool
) -> list[int]:
    """Frames of 30 with a new confirmed target."""
    tracker, image = MultiTargetTracker(settings), np.full((300, 500), 90, np.uint8)
    found = {}
    for index in range(30):
        for report in confirmed(tracker.step(image, one_region(index, speed, score, growth, **observed))):
            found.setdefault(report.id, index)
    return list(found.values())


@pytest.mark.parametrize(
    ("speed", "min_travel", "is_confirmed"), [(1.5, 4.0, True), (0.1, 4.0, False), (0.1, 0.0, True)]
)
def test_a_target_moves_before_it_is_confirmed(speed: float, min_travel: float, is_confirmed: bool):
    """It moves by `min-travel`, px over the ground; speeds are px a frame. 0 asks for no motion at all."""
    found = first_confirmations(TrackerSettings(min_travel=min_travel), speed, 1.0, 1.0)
    assert bool(found) == is_confirmed


@pytest.mark.parametrize(
    ("score", "least", "is_confirmed"),
    [(0.5, 0.33, True), (0.25, 0.33, False), (0.25, 0.2, True), (np.nan, 0.33, True)],
)
def test_a_faint_region_confirms_no_target(score: float, least: float, is_confirmed: bool):
    """The mean score of its last detections is at least `birth-score`; what has no score is clear."""
    found = first_confirmations(TrackerSettings(birth_score=least), 2.0, score, 1.0)
    assert bool(found) == is_confirmed


@pytest.mark.parametrize(
    ("growth", "are_objects", "is_confirmed"),
    [(1.0, False, True), (1.3, False, True), (1.8, False, False), (1.8, True, True)],
)
def test_a_region_that_breaks_up_and_grows_together_confirms_no_target(
    growth: float, are_objects: bool, is_confirmed: bool
):
    """Its area keeps within a factor of its mean, unlike that of structures that shift; objects are given."""
    found = first_confirmations(TrackerSettings(), 2.0, 1.0, growth, are_objects=are_objects)
    assert bool(found) == is_confirmed


@pytest.mark.parametrize(
    ("score", "growth", "settings", "cause"),
    [
        (0.25, 1.0, {}, "waits, faint: mean score 0.25, birth-score=0.33"),
        (1.0, 1.8, {}, "waits, its size changes: deviation 0.58 of the log area, at most 0.4"),
        (1.0, 1.0, {"min_travel": 90.0}, "waits, hardly moved: 12.0 px, min-travel=90"),
        (1.0, 1.0, {"birth_hits": 9, "birth_window": 9}, "waits, detected too seldom: 8 of the last 9"),
        (1.0, 1.0, {"max_targets": 1}, "waits, there is no room: max-targets=1"),
    ],
)
def test_a_waiting_target_names_the_rule_and_its_numbers(
    score: float, growth: float, settings: dict[str, float], cause: str
):
    """For `streamkit explain`, in every frame in which it is detected and not confirmed."""
    tracker = MultiTargetTracker(TrackerSettings(**settings))
    image = np.random.default_rng(1).integers(0, 255, (300, 500), np.uint8)
    if "max_targets" in settings:
        tracker.start_target(image, np.array([300.0, 200.0, 30.0, 30.0, 0.0]), Observation(0.04))
    for index in range(8):
        reports = tracker.step(image, one_region(index, 2.0, score, growth))
    assert reports[-1].provenance.cause.startswith(cause)


def flicker(
    frames: int, car_from: int, life: int = 4, step_s: float = 0.04, **observed: bool
) -> Iterator[Observation]:
    """Regions that move and are detected for `life` frames each, and from one frame on a car among them."""
    for index in range(frames):
        age = index % life
        corners = [(40.0 + 90 * slot + 4 * age, 40.0 + 70 * (index // life % 3)) for slot in range(5)]
        if index >= car_from:
            corners.append((30.0 + 4 * (index - car_from), 260.0))
        boxes = np.array([[x, y, x + 24, y + 12] for x, y in corners])
        yield Observation(step_s, centroids=(boxes[:, :2] + boxes[:, 2:]) / 2, boxes=boxes, **observed)


def test_a_target_that_waits_says_why():
    """Its provenance has the reason in the frames in which all else would confirm it."""
    tracker, image = MultiTargetTracker(), np.full((300, 500), 90, np.uint8)
    reports = [report for seen in flicker(60, 100) for report in tracker.step(image, seen)]
    waiting = [report.state for report in reports if report.provenance.cause.startswith("waits")]
    assert len(waiting) > 20
    assert set(waiting) == {TrackState.TENTATIVE}


def first_confirmed(settings: TrackerSettings, **observed: Any) -> dict[int, tuple[int, bool]]:
    """By id the frame in which a target of `flicker` is confirmed first, and whether it is the car."""
    tracker, image = MultiTargetTracker(settings), np.full((300, 500), 90, np.uint8)
    found: dict[int, tuple[int, bool]] = {}
    for index, observation in enumerate(flicker(160, 100, **observed)):
        for one in confirmed(tracker.step(image, observation)):
            found.setdefault(one.id, (index, one.turned_box[1] > 240))
    return found


@pytest.mark.parametrize(("step_s", "are_lasting"), [(0.04, False), (0.08, True)])
def test_regions_last_for_a_time_not_for_a_number_of_frames(step_s: float, are_lasting: bool):
    """Ten frames are less than `lasting-hits` at 25 a second, and more than its time at half of that."""
    found = first_confirmed(TrackerSettings(), life=10, step_s=step_s).values()
    assert any(not is_car and frame >= 60 for frame, is_car in found) == are_lasting


def test_where_regions_flicker_a_target_is_confirmed_once_it_lasts():
    """After some that ended only the car is confirmed; without the rule all are, of a detector's, too."""
    found = list(first_confirmed(TrackerSettings()).values())
    assert [frame for frame, is_car in found if not is_car and frame >= 40] == []
    (when,) = [frame for frame, is_car in found if is_car]
    assert 102 <= when <= 115
    all_of_them = first_confirmed(TrackerSettings(lasting_hits=0)).values()
    assert sum(not is_car and frame >= 40 for frame, is_car in all_of_them) > 50
    objects = first_confirmed(TrackerSettings(), are_objects=True).values()
    assert sum(not is_car and frame >= 40 for frame, is_car in objects) > 20
