"""Settings of the differencer; each is a property of `framediff` of the same name."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from streamkit.settings import setting


class Criterion(enum.StrEnum):
    """Merge criterion J_mn: the gap between two fragments, or the scatter that merging them adds."""

    GAP = "gap"
    SCATTER = "scatter"


@dataclass(frozen=True, slots=True)
class BackgroundSettings:
    """Settings of the background model."""

    frame_interval: int = setting(
        3,
        min=1,
        max=30,
        unit="frames",
        aliases=("tau",),
        doc="Interval of the frame difference; the paper's tau.",
    )
    quiet_frames: int = setting(
        12,
        min=1,
        max=255,
        unit="frames",
        doc="Frames without change after which a pixel becomes background; the paper's lambda.",
    )
    change_threshold: float = setting(
        18.0,
        min=0.0,
        max=255.0,
        live=True,
        unit="grey levels",
        doc="Smallest difference over frame-interval that is a change; the paper's T_s.",
        aliases=("ts",),
    )
    foreground_threshold: float = setting(
        7.0,
        min=0.0,
        max=255.0,
        live=True,
        unit="grey levels",
        doc="Smallest difference from the background that is foreground; the paper's T_F.",
        aliases=("tf",),
    )
    noise_gain: float = setting(
        4.0,
        min=0.0,
        max=20.0,
        live=True,
        doc="Foreground threshold in standard deviations of a pixel's noise, at least foreground-threshold; "
        "0 is off.",
    )
    learning_rate: float = setting(
        0.08,
        min=0.0,
        max=1.0,
        live=True,
        unit="per frame",
        doc="Weight of a frame in the background; the paper's alpha.",
        aliases=("alpha",),
    )
    tolerance: int = setting(
        -1,
        min=-1,
        max=8,
        live=True,
        unit="px",
        doc="Registration error to tolerate, at the working scale; -1 is 0 at full resolution, else 1.",
    )
    hysteresis_ratio: float = setting(
        0.5,
        min=0.0,
        max=1.0,
        live=True,
        doc="Lower threshold of the hysteresis, as a share of the upper one: a pixel above it that touches "
        "foreground is foreground; needs a tolerance above 0; 1 is off.",
        aliases=("weak",),
    )
    gradient_gain: float = setting(
        0.3,
        min=0.0,
        max=4.0,
        live=True,
        doc="Share of the local range of values that is added to change-threshold under a camera that flies, "
        "so that what is tall and errors of the registration at edges are no changes.",
    )
    frame_threshold: float = setting(
        0.75,
        min=0.05,
        max=1.0,
        live=True,
        doc="Share of the frame that must show another scene, for three frames, for the model to be reset.",
    )
    absorb_frames: int = setting(
        60,
        min=0,
        max=65535,
        live=True,
        unit="frames",
        doc="Frames after which an object that has stopped becomes background.",
        aliases=("absorb",),
    )
    shadow: bool = setting(
        False,
        live=True,
        doc="Removes shadows, for a quarter more time; objects as grey as a shadow suffer.",
    )


@dataclass(frozen=True, slots=True)
class ObjectSettings:
    """Settings of what counts as an object."""

    parallax: float = setting(
        0.5,
        min=0.0,
        max=1.0,
        live=True,
        doc="Behind stitch, removes the parallax of objects as tall as this share of the camera's height "
        "above them; objects that move slowly towards the camera may be lost; 0 is off.",
    )
    median: int = setting(
        7, min=0, max=13, live=True, unit="px", doc="Width of the median filter on the foreground; 0 is off."
    )
    fill_holes: bool = setting(True, live=True, doc="Fills what foreground encloses.")
    min_area: int = setting(
        3, min=1, max=100000, live=True, unit="cells", doc="Smallest object; a cell is 4 by 4 px."
    )
    merge_gap: int = setting(
        -1,
        min=-1,
        max=100,
        live=True,
        unit="cells",
        doc="Fragments nearer than this are one object; -1 is 3 at full resolution, else 1, and in traffic "
        "an object larger than most is taken apart where the ground shows through.",
    )
    merge_criterion: Criterion = setting(
        Criterion.GAP,
        live=True,
        doc="Merge criterion, the paper's J_mn: gap between fragments, or scatter of cells in a cluster.",
    )
    # What creeps changes at its front and rear only: this is a fortieth of its length in quiet_frames.
    min_change: float = setting(
        0.05,
        min=0.0,
        max=1.0,
        live=True,
        doc="Share of an object that must have changed within quiet-frames; with less it has stopped.",
    )
    stopped: bool = setting(
        False,
        live=True,
        doc="Also reports objects that have stopped, labelled `stopped`, until absorb-frames; the others are "
        "labelled `moving`.",
    )
    max_objects: int = setting(
        300,
        min=1,
        max=10000,
        live=True,
        doc="Most detections in a frame; the ones with the best scores stay.",
    )


@dataclass(frozen=True, slots=True)
class DifferencerSettings:
    """All settings of the differencer, a snapshot for one frame."""

    working_scale: int = setting(
        0,
        min=0,
        max=4,
        unit="px",
        doc="Frame pixels per pixel of the model, along each axis: 1, 2 or 4; 0 goes by the frame's width.",
    )
    background: BackgroundSettings = BackgroundSettings()
    objects: ObjectSettings = ObjectSettings()
