"""One track in one frame, as recorded."""

from __future__ import annotations

import msgspec


class Match(msgspec.Struct, frozen=True):
    """The detection a track was given: see `streamkit` records; px of the frame."""

    row: int
    centroid: tuple[float, float]
    bbox: tuple[float, float, float, float]
    area: float
    score: float
    gate: float | None = None
    label: str | None = None


class Origin(msgspec.Struct, frozen=True):
    """How a row was computed, as far as the file has it."""

    predicted: tuple[float, float] | None = None
    detection: Match | None = None
    shared: bool = False
    similarity: float | None = None
    learnt: bool = False
    cause: str | None = None


class FramePlace(msgspec.Struct, frozen=True):
    """How the frame was placed on the ground."""

    status: str
    reference: int
    matches: int | None = None
    inliers: int | None = None
    rmse: float | None = None


class Target(msgspec.Struct, frozen=True):
    """The row of a track: pixels of the frame, radians, px/s on the reference plane."""

    state: str
    x: float
    y: float
    length: float
    width: float
    angle: float
    score: float
    age_ns: int
    vx: float | None = None
    vy: float | None = None
    position_covariance: tuple[tuple[float, float], tuple[float, float]] | None = None
    provenance: Origin | None = None


class Moment(msgspec.Struct, frozen=True):
    """A track in a frame.

    Attributes:
        frame: its number at the source.
        epoch: increases when the seconds start from 0 again.
        seconds: time in the stream, or None.
        place: of the frame, or None.
        target: the row of the track.
    """

    frame: int
    epoch: int
    seconds: float | None
    place: FramePlace | None
    target: Target

    @property
    def when(self) -> str:
        """The time in words; the frame where there is no time."""
        return f"frame {self.frame}" if self.seconds is None else f"{self.seconds:.3f} s"

    @property
    def match(self) -> Match | None:
        """The detection, or None."""
        return None if self.target.provenance is None else self.target.provenance.detection
