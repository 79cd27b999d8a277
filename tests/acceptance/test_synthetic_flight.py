"""The main job on a synthetic flight, judged against its exact truth."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from streamkit import Frame, Pipeline, Registration, Tracks, TrackState
from streamkit_video import TrueRegistration, TrueTargets

FRAMES = 150
CARS = 12
NEAR_PX = 10.0
DESCRIPTION = (
    f"dronetestsrc num-buffers={FRAMES} cars={CARS} seed=1 ! video/x-raw, width=1280, height=720 "
    "! queue max-size-buffers=4 ! stitch ! queue max-size-buffers=4 ! framediff ! waveleteigen "
    "! queue max-size-buffers=4 ! particletrack ! appsink name=out max-buffers=8"
)


@dataclass
class Score:
    """What a run got right."""

    true_cars: int = 0
    matched: int = 0
    false_tracks: int = 0
    frames: int = 0
    corner_errors_px: list[float] = field(default_factory=list)

    def add(self, frame: Frame) -> None:
        """Scores one frame."""
        truth, tracks = frame.get(TrueTargets), frame.get(Tracks)
        assert truth is not None
        assert tracks is not None
        confirmed = np.array(
            [(t.x, t.y) for t in tracks.tracks if t.state is TrackState.CONFIRMED], np.float64
        ).reshape(-1, 2)
        hits = match_count(truth.centres, confirmed)
        self.frames += 1
        self.true_cars += len(truth.centres)
        self.matched += hits
        self.false_tracks += len(confirmed) - hits
        self.corner_errors_px += corner_errors(frame)


def match_count(truth: NDArray[np.float64], found: NDArray[np.float64]) -> int:
    """How many true positions have a found one within 10 px, each used once."""
    if not len(truth) or not len(found):
        return 0
    distance = np.linalg.norm(truth[:, None] - found[None], axis=2)
    rows, columns = scipy.optimize.linear_sum_assignment(np.minimum(distance, 10 * NEAR_PX))
    return int((distance[rows, columns] <= NEAR_PX).sum())


def corner_errors(frame: Frame) -> list[float]:
    """Distance on the reference plane between where a frame's corners are and where they were put, px."""
    true, found = frame.get(TrueRegistration), frame.get(Registration)
    assert true is not None
    assert found is not None
    width, height = frame.caps.integer("width"), frame.caps.integer("height")
    corners = np.array([[[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]], np.float64)
    difference = cv2.perspectiveTransform(corners, found.to_reference) - cv2.perspectiveTransform(
        corners, true.to_reference
    )
    return [float(value) for value in np.linalg.norm(difference[0], axis=1)]


@pytest.fixture(scope="module")
def score() -> Score:
    """One run over the whole flight."""
    result = Score()
    with Pipeline.parse(DESCRIPTION) as pipeline:
        pipeline.play()
        for frame in pipeline["out"]:
            result.add(frame)
    return result


@pytest.mark.timeout(240)
def test_every_frame_arrives(score: Score) -> None:
    """A file-like source loses nothing."""
    assert score.frames == FRAMES


def test_cars_are_followed(score: Score) -> None:
    """At least 80 % of the true car positions have a confirmed track within 10 px."""
    assert score.matched / score.true_cars >= 0.80, score.matched / score.true_cars


def test_few_false_tracks(score: Score) -> None:
    """At most 0.5 confirmed tracks a frame are on no car."""
    assert score.false_tracks / score.frames <= 0.5, score.false_tracks / score.frames


def test_registration_is_true(score: Score) -> None:
    """The median error of the frame's corners on the reference plane is below 1 px."""
    assert np.median(score.corner_errors_px) < 1.0, np.median(score.corner_errors_px)
