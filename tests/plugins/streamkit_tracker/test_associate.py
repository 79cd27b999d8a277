"""Gated assignment."""

import numpy as np

from streamkit_tracker import associate
from streamkit_tracker.observation import FrameContinuity, Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import TARGET, TargetRows, TargetTable
from streamkit_tracker.tracker import MultiTargetTracker


def expected(*, variances: tuple[float, float] = (8.0, 3.0)) -> TargetRows:
    """One target of 20 by 10 px at the origin, whose detections scatter by 1 px."""
    rows = np.zeros(1, TARGET)
    rows["covariance"] = np.diag([*variances, 0.0, 0.0])
    rows["box"] = 20.0, 10.0
    return rows


def detected(x: float, y: float, width: float = 20.0, height: float = 10.0) -> list[float]:
    """A detection with its centroid in the middle of its box."""
    return [x, y, x - width / 2, y - height / 2, x + width / 2, y + height / 2]


def pairs(costs: np.ndarray) -> list[tuple[int, int]]:
    """What is assigned of detections that all lie on all targets and differ by their features alone."""
    count, found = costs.shape
    table = TargetTable(TrackerSettings(), np.repeat(expected(), count))
    table.rows["detection"] = -1
    seen, every = np.repeat([detected(0.0, 0.0)], found, axis=0), np.ones(count, np.bool_)
    left = associate.assign(table, every, np.arange(found), seen, costs, every)
    taken = table.rows["detection"].tolist()
    assert sorted([*left.tolist(), *(column for column in taken if column >= 0)]) == list(range(found))
    return [(row, column) for row, column in enumerate(taken) if column >= 0]


def test_the_total_cost_counts_not_the_nearest():
    """Two targets claim one detection: the pairing with the least total cost wins."""
    assert pairs(np.array([[1.0, 2.0], [1.5, 9.0]])) == [(0, 1), (1, 0)]


def test_pairs_outside_the_gate_stay_apart():
    """What is not allowed is not paired, even when nothing else is left."""
    assert pairs(np.array([[1.0, np.inf], [np.inf, np.inf]])) == [(0, 0)]
    assert pairs(np.zeros((0, 3))) == []


def test_equal_costs_are_no_trouble():
    """Where every pairing is as good as any other each row still gets a column of its own."""
    found = pairs(np.ones((5, 4)))
    assert len({row for row, _ in found}) == len({column for _, column in found}) == len(found) == 4


def test_costs_beyond_all_measure_end_nothing():
    """A cost near the largest float, or none at all, is the last choice."""
    assert (1, 2) in pairs(np.array([[1e308, np.nan, 2.0], [1e308, np.inf, 1.0]]))


def compare(rows: TargetRows, detected: np.ndarray, unlike: np.ndarray) -> associate.Comparison:
    """All rows compared with all detections."""
    return associate.compare(rows, np.arange(len(rows)), detected, unlike, np.zeros(len(rows), np.bool_))


def test_distance_is_in_standard_deviations():
    """A 3 px offset along an axis of variance 8 + 1 is one standard deviation."""
    seen = np.array([detected(3.0, 0.0), detected(0.0, 4.0)])
    np.testing.assert_allclose(compare(expected(), seen, np.zeros((1, 2))).distances, [[1.0, 4.0]])


def test_a_pair_costs_its_distance_its_size_and_what_it_is_unlike():
    """One standard deviation, half the longer side too wide, and 0.25 for the look."""
    seen = np.array([detected(3.0, 0.0, width=30.0)])
    found = compare(expected(), seen, np.full((1, 1), 0.25))
    np.testing.assert_allclose(found.costs, [[1.0 + 0.25 + 0.25]])
    np.testing.assert_allclose(found.mismatch, [[10.0]])


def test_outside_the_gate_only_overlapping_boxes_pair_and_they_come_last():
    """A covariance that is too small does not free what lies upon the target; farther detections are free."""
    sure = expected(variances=(0.01, 0.01))
    found = compare(sure, np.array([detected(8.0, 0.0), detected(19.0, 0.0)]), np.zeros((1, 2)))
    assert np.isfinite(found.costs[0, 0])
    assert found.costs[0, 0] > 100
    assert np.isinf(found.costs[0, 1])
    near = compare(expected(), np.array([detected(7.0, 9.0)]), np.zeros((1, 1)))
    assert near.distances[0, 0] > 16
    assert np.isinf(near.costs[0, 0])


def test_a_box_touches_bodies():
    """Two targets lie in one box, one of them with its centre outside."""
    pair = np.concatenate([expected(), expected()])
    pair["mean"][1, :2] = 15.0, 0.0
    found = compare(pair, np.array([detected(0.0, 0.0), detected(200.0, 0.0)]), np.zeros((2, 2)))
    np.testing.assert_array_equal(found.touched, [2, 0])


IMAGE = np.zeros((240, 320), np.uint8)


def objects(*rows: tuple[float, float]) -> Observation:
    """Objects of 20 by 40 px at y = 100 px, one for each x and score."""
    x, scores = np.array(rows).reshape(-1, 2).T
    boxes = np.column_stack([x - 10, np.full(len(x), 80.0), x + 10, np.full(len(x), 120.0)])
    return Observation(
        0.04, centroids=(boxes[:, :2] + boxes[:, 2:]) / 2, boxes=boxes, scores=scores, are_objects=True
    )


def test_a_weak_detection_continues_a_target_but_starts_none():
    """Of two places, one scores a tenth: no target starts there. The other fades, and is followed on."""
    tracker = MultiTargetTracker()
    for _ in range(10):
        reports = tracker.step(IMAGE, objects((60, 0.8), (200, 0.08)))
    assert [report.turned_box[0] for report in reports] == [60.0]
    for _ in range(10):
        (faded,) = tracker.step(IMAGE, objects((60, 0.2)))
    assert faded.id == reports[0].id
    assert faded.state == "confirmed"


def test_an_object_is_found_again_after_a_longer_time_than_it_was_seen():
    """Seen for 0.4 s and hidden for 1.6 s, it comes back 24 px, more than its width, from its prediction."""
    tracker = MultiTargetTracker()
    for _ in range(10):
        (before,) = tracker.step(IMAGE, objects((60, 0.8)))
    for _ in range(40):
        tracker.step(IMAGE, objects())
    (after,) = tracker.step(IMAGE, objects((84, 0.8)))
    assert after.id == before.id
    assert after.state == "confirmed"


def test_a_weak_detection_does_not_bring_an_object_back():
    """After some frames without any, a faint box is as often something else."""
    tracker = MultiTargetTracker()
    for _ in range(10):
        tracker.step(IMAGE, objects((60, 0.8)))
    for _ in range(6):
        tracker.step(IMAGE, objects())
    assert all(report.state != "confirmed" for report in tracker.step(IMAGE, objects((60, 0.1))))
    assert [report.state for report in tracker.step(IMAGE, objects((60, 0.8)))] == ["confirmed"]


def test_a_strong_detection_is_chosen_before_a_weak_one_that_lies_nearer():
    """A faint box half upon a target does not take it, however well it fits."""
    tracker = MultiTargetTracker()
    for _ in range(10):
        tracker.step(IMAGE, objects((60, 0.8)))
    (report,) = tracker.step(IMAGE, objects((60, 0.1), (64, 0.9)))
    assert report.provenance.detection == 1


def test_weak_is_relative_to_what_a_detector_usually_scores():
    """Scores of .05 are strong where none is higher; many faint boxes do not lower the usual score much."""
    low, many = TargetTable(TrackerSettings()), TargetTable(TrackerSettings())
    assert not associate.find_weak(low, np.full(4, 0.05)).any()
    scores = np.array([0.9, 0.8, *[0.05] * 30])
    np.testing.assert_array_equal(associate.find_weak(many, scores), scores < 0.5)


def test_a_score_that_is_no_number_is_not_weak():
    """NaN and infinity count as the highest score; what is below 0 as the lowest."""
    scores = np.array([0.9, np.nan, np.inf, -np.inf, -3.0])
    weak = associate.find_weak(TargetTable(TrackerSettings()), scores)
    np.testing.assert_array_equal(weak, [False, False, False, True, True])


def test_an_object_that_moves_farther_than_its_size_is_found_near_its_prediction():
    """20 px at 40 px a look: no box overlaps the last one, and the target is confirmed all the same."""
    tracker, image = MultiTargetTracker(), np.full((200, 400), 90, np.uint8)
    for look in range(6):
        boxes = np.array([[20.0 + 40 * look, 80, 40 + 40 * look, 100]])
        middles = (boxes[:, :2] + boxes[:, 2:]) / 2
        reports = tracker.step(image, Observation(0.2, centroids=middles, boxes=boxes, are_objects=True))
    assert [(report.id, str(report.state)) for report in reports] == [(1, "confirmed")]


def test_a_frame_without_registration_is_no_look():
    """A target is not missed where its detections could not be used."""
    tracker, image = MultiTargetTracker(), np.full((200, 400), 90, np.uint8)
    box = np.array([[20.0, 80, 60, 120]])
    for _ in range(4):
        tracker.step(image, Observation(0.04, centroids=box[:, :2] + 20, boxes=box, are_objects=True))
    for _ in range(20):
        reports = tracker.step(image, Observation(0.04, continuity=FrameContinuity.LOST, are_objects=True))
    assert [(report.id, str(report.state)) for report in reports] == [(1, "coasting")]


def test_a_car_that_turns_is_found_after_a_gap():
    """22 px long, 150 px/s, turning by 1.2 rad/s: three missed frames do not end its id."""
    tracker, image = MultiTargetTracker(), np.full((500, 400), 90, np.uint8)
    for look in range(60):
        angle = 1.2 * 0.04 * look
        middle = np.array([[200 + 125 * np.sin(angle), 325 - 125 * np.cos(angle)]])
        shown = middle[look % 10 in (6, 7, 8) :]
        boxes = np.column_stack([shown - np.array([11, 8]), shown + np.array([11, 8])])
        reports = tracker.step(image, Observation(0.04, centroids=shown, boxes=boxes, are_objects=True))
    assert [report.id for report in reports] == [1]


def test_what_appears_far_away_is_not_an_object_that_left_long_ago():
    """A gate that is wider than the object allows any place: after 2 s it is not used."""
    tracker, image = MultiTargetTracker(), np.full((200, 800), 90, np.uint8)
    for look in range(75):
        middles = np.array([[100.0 + 8 * look, 100]])[look >= 25 :] if look < 74 else np.array([[400.0, 100]])
        boxes = np.column_stack([middles - np.array([10, 20]), middles + np.array([10, 20])])
        reports = tracker.step(image, Observation(0.04, centroids=middles, boxes=boxes, are_objects=True))
    assert [(report.id, report.provenance.detection) for report in reports] == [(2, 0)]
