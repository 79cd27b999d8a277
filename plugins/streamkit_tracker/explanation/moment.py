"""One track in one frame, as recorded."""

from __future__ import annotations

from dataclasses import dataclass, field

from streamkit_tracker.report.reports import TargetProvenance


@dataclass(frozen=True)
class Match:
    """The detection a track was given.

    Attributes:
        centroid: x and y, px.
        box: x0 y0 x1 y1, px.
        area: px.
        score: 0 to 1.
        label: a word, or None.
    """

    centroid: tuple[float, float]
    box: tuple[float, float, float, float]
    area: float
    score: float
    label: str | None = None


@dataclass(frozen=True)
class FramePlace:
    """How the frame was placed on the ground.

    Attributes:
        status: ok, weak, lost, cut or still.
        reference: number of the plane.
        matches: points matched, or None where the record does not tell.
        inliers: points that agree, or None.
        rmse: px, or None.
    """

    status: str
    reference: int
    matches: int | None = None
    inliers: int | None = None
    rmse: float | None = None


@dataclass(frozen=True)
class Moment:
    """A track in a frame.

    Attributes:
        frame: its number at the source.
        epoch: goes up when the seconds start anew.
        seconds: time in the stream, or None.
        state: tentative, confirmed, coasting or lost.
        window: x y length width, px, and angle, rad.
        velocity: px/s on the reference plane, or None.
        spread: standard deviations of x and y, px, or None.
        score: 0 to 1.
        age_s: since the track began.
        place: of the frame, or None.
        provenance: where the row comes from, or None where the file does not tell.
        match: the detection, or None.
    """

    frame: int
    epoch: int
    seconds: float | None
    state: str
    window: tuple[float, float, float, float, float]
    velocity: tuple[float, float] | None = None
    spread: tuple[float, float] | None = None
    score: float = 0.0
    age_s: float = 0.0
    place: FramePlace | None = None
    provenance: TargetProvenance | None = field(default=None)
    match: Match | None = None

    @property
    def when(self) -> str:
        """The time in words; the frame where there is no time."""
        return f"frame {self.frame}" if self.seconds is None else f"{self.seconds:.3f} s"
