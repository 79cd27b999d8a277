"""The table of targets: one row for each, with named fields, and the objects that one target alone needs."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.initiate.trail import Trail
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.update.evidence import Evidence
from streamkit_tracker.update.layered_filter import Particles
from streamkit_tracker.update.memory import Memory
from streamkit_tracker.window_geometry import FloatArray, Number

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
TargetRows = NDArray[Any]

TENTATIVE, CONFIRMED, COASTING, LOST = range(4)
INITIAL_CREDIT_S = 0.2
SPEED_SHARE = 1 / 3  # of the fastest speed: standard deviation of the velocity before it is known

# Positions are pixels of the latest frame; x right, y down.
TARGET = np.dtype(
    [
        ("id", np.int64),
        ("state", np.int64),  # TENTATIVE, CONFIRMED, COASTING or LOST
        ("manual", np.bool_),  # drawn by hand: neither shape nor heading follow detections
        ("window", np.float64, 5),  # x y length width, px, and angle, rad
        ("mean", np.float64, 4),  # x y, px, and velocity, px/s, with the camera's motion taken out
        ("covariance", np.float64, (4, 4)),
        ("drawn_angle", np.float64),  # rad, of the drawn window
        ("age_s", np.float64),
        ("credit_s", np.float64),  # how much longer the target may coast
        ("hits", np.float64, 100),  # 1 where it was detected, the latest frame first; NaN before it began
        ("frames_undetected", np.int64),
        ("frames_unseen", np.int64),
        ("score", np.float64),  # similarity to the template, kept from the last comparison
        ("last_place", np.float64, 2),  # x y of the window when it was last recognised, px of that frame
        # what detections have shown
        ("whole", np.bool_),  # detections show the whole target: a detector's, and large regions
        ("box", np.float64, 2),  # width and height of the upright box, px
        ("detected_s", np.float64),  # time it was detected by itself
        ("offset", np.float64, 2),  # of the detections from the window on average, px
        ("misfits", np.int64),  # frames in which window and detection did not overlap enough
        # of this frame
        ("predicted", np.float64, 2),  # x y before the frame was searched, px; NaN in the first
        ("detection", np.int64),  # row of the frame's detections; -1 is none
        ("gate", np.float64),  # distance of the detection, standard deviations
        ("detection_std", np.float64),  # of its centroid, px
        ("crowded", np.bool_),  # the detection's box holds other targets, too
        ("shared", np.bool_),  # another target's detection covers this one
        ("similarity", np.float64),  # of the best window to the template, 0 to 1; NaN where not compared
        ("recognised", np.bool_),
        ("sure", np.bool_),  # its last responses were sharp; always for targets without a filter
        ("learnt", np.bool_),  # the template has learnt this frame
        ("filter_share", np.float64),  # how far the correlation filter learns this frame, 0 to 1
        ("measured", np.bool_),
        ("measurement", np.float64, 2),  # x y, px
        ("noise", np.float64, (2, 2)),  # covariance of the measurement, px squared
        ("visible", np.float64),  # part of the window inside the frame, 0 to 1
        ("restart", np.bool_),  # the window is wrong, and begins again at the next one
        ("restart_window", np.float64, 5),
    ]
)


class TargetState(enum.StrEnum):
    """State of a target, in the order of the codes in the table."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(eq=False)
class Appearance:
    """Appearance of a confirmed target.

    Attributes:
        template: windows are compared with it.
        particles: of the layered filter.
        patch: samples of a patch (rows, columns).
        context: side of the sampled window relative to the target's.
        discriminator: correlation filter against the background, for targets drawn by hand.
        response: of the discriminator in this frame, or None.
        memory: of the discriminator.
    """

    template: EigenTemplate | FeatureTemplate
    particles: Particles
    patch: tuple[int, int]
    context: float
    discriminator: CorrelationFilter | None = None
    response: Response | None = None
    memory: Memory | None = None


@dataclass(eq=False)
class TargetModel:
    """Objects of one target.

    Attributes:
        generator: its only source of chance.
        evidence: when it counts as seen.
        trail: its detected positions.
        appearance: None before the target is confirmed.
        feature: float64[k], mean of its detections' feature vectors, or None.
        feature_version: of the space they are in.
    """

    generator: np.random.Generator
    evidence: Evidence
    trail: Trail
    appearance: Appearance | None = None
    feature: FloatArray | None = None
    feature_version: int = 0


@dataclass(eq=False)
class TargetTable:
    """All targets, in order of their ids.

    Attributes:
        rows: structured array of `TARGET`, one for each.
        models: their objects, in the same order.
        causes: by id, why targets began, were confirmed or ended in this frame.
        confirmed: number of targets that were ever confirmed.
    """

    rows: TargetRows = field(default_factory=lambda: np.zeros(0, TARGET))
    models: list[TargetModel] = field(default_factory=list)
    causes: dict[int, str] = field(default_factory=dict)
    next_id: int = 1
    confirmed: int = 0

    def add(self, window: FloatArray, settings: TrackerSettings, *, manual: bool, cause: str) -> int:
        """Appends a tentative target at a window, float64[5]; returns its row."""
        row = np.zeros(1, TARGET)
        side = float(np.sqrt(window[2] * window[3]))
        position_std, speed_std = centroid_std(side), settings.max_speed * SPEED_SHARE
        row["id"], row["manual"], row["window"], row["drawn_angle"] = self.next_id, manual, window, window[4]
        row["mean"][0, :2], row["box"] = window[:2], window[2:4]
        row["covariance"] = np.diag([position_std**2, position_std**2, speed_std**2, speed_std**2])
        row["credit_s"], row["score"], row["last_place"] = INITIAL_CREDIT_S, 1.0, window[:2]
        row["predicted"] = row["gate"] = row["similarity"] = np.nan
        row["detection"] = -1
        row["hits"], row["hits"][0, 0] = np.nan, 1.0
        self.causes[self.next_id] = cause
        self.rows = np.concatenate([self.rows, row])
        self.models.append(
            TargetModel(
                np.random.default_rng((settings.seed, self.next_id)),
                Evidence(settings.lost_threshold, settings.update_threshold),
                Trail((float(window[0]), float(window[1]))),
            )
        )
        self.next_id += 1
        return len(self.models) - 1

    def confirm(self, index: int) -> None:
        """Confirms the target in a row for the first time."""
        self.rows["state"][index] = CONFIRMED
        self.confirmed += 1

    def lose(self, index: int, cause: str) -> None:
        """Ends the target in a row."""
        self.rows["state"][index] = LOST
        self.causes[int(self.rows["id"][index])] = cause

    def drop_lost(self) -> None:
        """Removes the rows of lost targets, after they were reported."""
        kept = self.rows["state"] != LOST
        if kept.all():
            return
        self.rows = self.rows[kept]
        self.models = [model for model, keep in zip(self.models, kept.tolist(), strict=True) if keep]


def followed(rows: TargetRows) -> BoolArray:
    """bool[n]: targets that have left the tentative state and go on."""
    state = rows["state"]
    return np.asarray((state == CONFIRMED) | (state == COASTING))


def dormant(rows: TargetRows, lost_frames: int) -> BoolArray:
    """bool[n]: targets that only a detection finds again, unseen for `lost_frames`."""
    return np.asarray(~rows["manual"] & (rows["frames_unseen"] >= lost_frames))


@register_jitable
def centroid_std(side: Number) -> Number:
    """Standard deviation expected of a detection's centroid, px, for targets of these sides, px."""
    return 1.0 + 0.04 * side
