"""The table of targets: one row for each, with named fields, and the objects that one target alone needs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.mean_features import MeanFeatures
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.survival import Survival
from streamkit_tracker.update.drawn_target import DrawnTarget
from streamkit_tracker.update.evidence import Evidence
from streamkit_tracker.update.layered_filter import Particles
from streamkit_tracker.window_geometry import FloatArray, Number

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
TargetRows = NDArray[Any]

TENTATIVE, CONFIRMED, COASTING, LOST = range(4)  # codes of `TrackState`
INITIAL_CREDIT_S = 0.2  # before detections have earned any
SETTLED_S = 1.0  # of detections beyond its gaps: false regions of motion seldom last
SPEED_SHARE = 1 / 3  # of the fastest speed: standard deviation of the velocity before it is known

# Positions are pixels of the latest frame; x right, y down.
TARGET = np.dtype(
    [
        ("id", np.int64),
        ("state", np.int64),  # TENTATIVE, CONFIRMED, COASTING or LOST
        ("drawn", np.bool_),  # drawn by hand: neither shape nor heading follow detections
        ("window", np.float64, 5),  # x y length width, px, and angle, rad
        ("mean", np.float64, 4),  # x y, px, and velocity, px/s, with the camera's motion taken out
        ("covariance", np.float64, (4, 4)),
        ("drawn_angle", np.float64),  # rad, of the drawn window
        ("age_s", np.float64),
        ("credit_s", np.float64),  # how much longer the target may coast
        ("waited_s", np.float64),  # since a detector last ran; 0 for targets drawn by hand
        ("hits", np.float64, 100),  # 1 where it was detected, the latest frame first; NaN before it began
        ("detections", np.int64),  # frames in which it was detected
        ("frames_undetected", np.int64),
        ("frames_unseen", np.int64),
        ("score", np.float64),  # similarity to the template, kept from the last comparison
        ("last_position", np.float64, 2),  # x y of the window when it was last recognised, px of that frame
        # what detections have shown
        ("whole", np.bool_),  # detections show the whole target: a detector's, and large regions
        ("box", np.float64, 2),  # width and height of the upright box, px
        # of this frame
        ("detectable", np.bool_),  # a detector ran on the frame, or the target is drawn by hand
        ("predicted", np.float64, 2),  # x y before the frame was searched, px; NaN in the first
        ("detection", np.int64),  # row of the frame's detections; -1 is none
        ("gate", np.float64),  # distance of the detection, standard deviations
        ("detection_std", np.float64),  # of its centroid, px
        ("led", np.bool_),  # confirmed before, not drawn by hand, with a detection that shows it alone
        ("crowded", np.bool_),  # the detection's box holds other targets, too
        ("shared", np.bool_),  # and is the detection of each of them
        ("similarity", np.float64),  # of the best window to the template, 0 to 1; NaN where not compared
        ("recognised", np.bool_),
        ("sure", np.bool_),  # drawn by hand: its last responses were sharp
        ("unsure_s", np.float64),  # likewise: time since they were
        ("learnt", np.bool_),  # the template has learnt this frame
        ("filter_share", np.float64),  # how far the correlation filter learns this frame, 0 to 1
        ("measured", np.bool_),
        ("measurement", np.float64, 2),  # x y, px
        ("noise", np.float64, (2, 2)),  # covariance of the measurement, px squared
        ("visible", np.float64),  # part of the window inside the frame, 0 to 1
    ]
)
# Bytes of a row. NumPy joins and indexes rows field by field; `take` and `compress` copy bytes, in a tenth.
ROW = np.dtype((np.void, TARGET.itemsize))


@dataclass(eq=False)
class TargetModel:
    """Objects of one target.

    Attributes:
        generator: its only source of chance.
        evidence: when it counts as seen.
        trail: float64[n, 2], its last positions: detected ones before it is confirmed, those where it was
            recognised if it is drawn by hand; px of the latest frame.
        sightings: float64[n, 2], scores and logarithms of the areas of its last detections before it is
            confirmed.
        template: windows are compared with it; None before the target is confirmed.
        particles: of the layered filter; None while they are one, at the window.
        patch: samples of a compared patch (rows, columns).
        drawn: what follows a target drawn by hand, else None.
        features: mean of the feature vectors of its detections, or None.
    """

    generator: np.random.Generator
    evidence: Evidence
    trail: FloatArray
    sightings: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    template: EigenTemplate | FeatureTemplate | None = None
    particles: Particles | None = None
    patch: tuple[int, int] = (0, 0)
    drawn: DrawnTarget | None = None
    features: MeanFeatures | None = None

    def is_in_place(self, sampler: WindowSampler, window: FloatArray) -> bool:
        """Whether the filter of a target drawn by hand finds it near a window, float64[5]."""
        return self.drawn is not None and self.evidence.is_credible(
            self.drawn.filter.respond(sampler, window)
        )


@dataclass(eq=False)
class TargetTable:
    """All targets, in order of their ids.

    Attributes:
        rows: structured array of `TARGET`, one for each.
        models: their objects, in the same order.
        causes: by id, why targets began, were confirmed, wait or ended in this frame.
        closeness: for how many frames pairs of ids have been on one object.
        score_sums: float64[2], sums of the scores of objects and of their squares over some 50 frames.
        are_objects: whether the last detections were whole objects, and not regions of motion.
        survival: of the targets of regions of motion.
        confirmed: number of targets that were ever confirmed.
    """

    settings: TrackerSettings
    rows: TargetRows = field(default_factory=lambda: np.zeros(0, TARGET))
    models: list[TargetModel] = field(default_factory=list)
    causes: dict[int, str] = field(default_factory=dict)
    closeness: dict[tuple[int, int], int] = field(default_factory=dict)
    score_sums: FloatArray = field(default_factory=lambda: np.zeros(2))
    are_objects: bool = False
    survival: Survival = field(init=False)
    next_id: int = 1
    confirmed: int = 0

    def __post_init__(self) -> None:
        self.survival = Survival(self.settings.lasting_hits)

    def add(self, windows: FloatArray, *, drawn: bool, cause: str) -> int:
        """Appends tentative targets at windows, float64[n, 5]; returns the row of the first."""
        first, count = len(self.models), len(windows)
        rows = np.zeros(count, TARGET)
        sides = np.sqrt(windows[:, 2] * windows[:, 3]).tolist()
        variances = np.array([centroid_std(side) ** 2 for side in sides])
        speed_std = self.settings.max_speed * SPEED_SHARE
        rows["id"] = self.next_id + np.arange(count)
        rows["drawn"], rows["window"], rows["drawn_angle"] = drawn, windows, windows[:, 4]
        rows["mean"][:, :2], rows["box"] = windows[:, :2], windows[:, 2:4]
        rows["covariance"][:, [0, 1], [0, 1]] = variances[:, None]
        rows["covariance"][:, [2, 3], [2, 3]] = speed_std**2
        rows["credit_s"], rows["score"], rows["last_position"] = INITIAL_CREDIT_S, 1.0, windows[:, :2]
        rows["predicted"] = rows["gate"] = rows["similarity"] = np.nan
        rows["detection"], rows["detections"] = -1, 1
        rows["hits"] = np.nan
        rows["hits"][:, 0] = 1.0
        self.rows = np.concatenate([self.rows.view(ROW), rows.view(ROW)]).view(TARGET)
        for number, window in zip(rows["id"].tolist(), windows, strict=True):
            self.causes[number] = cause
            generator = np.random.default_rng((self.settings.seed, number))
            evidence = Evidence(self.settings.lost_threshold, self.settings.update_threshold)
            self.models.append(TargetModel(generator, evidence, window[None, :2].copy()))
        self.next_id += count
        return first

    def confirm(self, index: int, cause: str) -> None:
        """Confirms the target in a row for the first time."""
        self.rows["state"][index] = CONFIRMED
        self.causes[int(self.rows["id"][index])] = cause
        self.confirmed += 1

    def lose(self, index: int, cause: str) -> None:
        """Ends the target in a row."""
        self.rows["state"][index] = LOST
        self.causes[int(self.rows["id"][index])] = cause

    def begin_frame(self) -> None:
        """Removes the rows of lost targets, which were reported, and resets the fields of the last frame."""
        kept = self.rows["state"] != LOST
        if not kept.all():
            self.rows = self.rows.compress(kept)
            self.models = [model for model, keep in zip(self.models, kept.tolist(), strict=True) if keep]
        rows, self.causes = self.rows, {}
        rows["last_position"][rows["recognised"]] = rows["window"][rows["recognised"], :2]
        rows["predicted"], rows["detection"] = rows["mean"][:, :2], -1
        rows["gate"] = rows["similarity"] = np.nan
        for name in ("crowded", "shared", "recognised", "learnt", "measured"):
            rows[name] = False
        rows["filter_share"] = 0.0

    @property
    def followed(self) -> BoolArray:
        """bool[n]: targets that have left the tentative state and go on."""
        state = self.rows["state"]
        return np.asarray((state == CONFIRMED) | (state == COASTING))

    @property
    def dormant(self) -> BoolArray:
        """bool[n]: targets that only a detection finds again, unseen for `lost_frames`."""
        unseen = self.rows["frames_unseen"] >= self.settings.lost_frames
        return np.asarray(~self.rows["drawn"] & unseen)

    @property
    def settled(self) -> int:
        """Number of targets that are not ended in favour of a new one."""
        is_drawn = self.rows["drawn"] & self.followed
        return int(np.count_nonzero(is_drawn | (self.rows["state"] == CONFIRMED)))


@register_jitable
def centroid_std(side: Number) -> Number:
    """Standard deviation expected of a detection's centroid, px, for targets of these sides, px."""
    return 1.0 + 0.04 * side
