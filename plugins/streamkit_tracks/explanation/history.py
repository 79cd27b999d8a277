"""The recorded moments of a track, and a summary of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import median

import msgspec

from streamkit import MatchRecord, RegistrationRecord, TargetRecord


class Moment(msgspec.Struct, frozen=True):
    """A track in a frame.

    Attributes:
        frame: its number at the source.
        epoch: increases when the seconds start from 0 again.
        seconds: time in the stream, or None.
        place: of the frame on the ground, or None.
        target: the row of the track.
    """

    frame: int
    epoch: int
    seconds: float | None
    place: RegistrationRecord | None
    target: TargetRecord

    @property
    def when(self) -> str:
        """The time in words; the frame where there is no time."""
        return f"frame {self.frame}" if self.seconds is None else f"{self.seconds:.3f} s"

    @property
    def match(self) -> MatchRecord | None:
        """The detection, or None."""
        return None if self.target.provenance is None else self.target.provenance.detection


@dataclass(frozen=True)
class Life:
    """A track up to a moment.

    Attributes:
        frames: in which it has a row.
        detected: of these, with a detection of its own.
        shared: of these, with the detection of another track that covers this one.
        gates: median and largest distance of its detections, standard deviations, or None.
        similarities: median and least similarity, or None.
        learnt: frames its appearance was learnt from.
        registrations: frames by status of their registration.
        planes: numbers of the reference planes, in order.
        turns: the moments in which something was decided, or the state changed.
        gaps: first and last frame of each stretch without a detection.
    """

    frames: int
    detected: int
    shared: int
    gates: tuple[float, float] | None
    similarities: tuple[float, float] | None
    learnt: int
    registrations: dict[str, int]
    planes: tuple[int, ...]
    turns: tuple[Moment, ...]
    gaps: tuple[tuple[int, int], ...]


def life(moments: Sequence[Moment]) -> Life:
    """Sums up a track's moments, in order; there is at least one."""
    provenances = [moment.target.provenance for moment in moments if moment.target.provenance is not None]
    matches = [moment.match for moment in moments if moment.match is not None]
    gates = [match.gate for match in matches if match.gate is not None]
    similarities = [origin.similarity for origin in provenances if origin.similarity is not None]
    places = [moment.place for moment in moments if moment.place is not None]
    return Life(
        frames=len(moments),
        detected=len(matches),
        shared=sum(origin.shared for origin in provenances),
        gates=(median(gates), max(gates)) if gates else None,
        similarities=(median(similarities), min(similarities)) if similarities else None,
        learnt=sum(origin.learnt for origin in provenances),
        registrations=dict(Counter(place.status for place in places)),
        planes=tuple(dict.fromkeys(place.reference for place in places)),
        turns=turns(moments),
        gaps=_gaps(moments) if provenances else (),
    )


def turns(moments: Sequence[Moment], state: str | None = None) -> tuple[Moment, ...]:
    """The moments in which something was decided, or the state changed from that of the one before.

    Of moments in a row in which one rule kept the state, only the last one. `state` is that before the first
    moment; None where there was none.
    """
    found: list[Moment] = []
    rule = ""
    for moment in moments:
        target, earlier = moment.target, rule
        cause = "" if target.provenance is None else target.provenance.cause or ""
        rule = cause.partition(":")[0]
        if target.state == state and rule and rule == earlier:
            found[-1] = moment
        elif rule or target.state != state:
            found.append(moment)
        state = target.state
    return tuple(found)


def _gaps(moments: Sequence[Moment]) -> tuple[tuple[int, int], ...]:
    gaps = []
    for is_detected, stretch in groupby(moments, key=_is_detected):
        frames = [moment.frame for moment in stretch]
        if not is_detected:
            gaps.append((frames[0], frames[-1]))
    return tuple(gaps)


def _is_detected(moment: Moment) -> bool:
    origin = moment.target.provenance
    return origin is not None and (origin.detection is not None or origin.shared)


def moment_at(moments: Sequence[Moment], seconds: float, epoch: int | None) -> int | None:
    """Index of the moment nearest to a time, or None where the track is not there at that time.

    Without an epoch it is the first in which the track is there then.
    """
    for wanted in sorted({moment.epoch for moment in moments}) if epoch is None else [epoch]:
        stamped = [
            (moment.seconds, index)
            for index, moment in enumerate(moments)
            if moment.epoch == wanted and moment.seconds is not None
        ]
        if not stamped:
            continue
        apart, index = min((abs(at - seconds), index) for at, index in stamped)
        # a time as near to an end as half the usual step is still inside
        begin, end = stamped[0][0], stamped[-1][0]
        half_step = (end - begin) / (len(stamped) - 1) / 2 + 1e-9 if len(stamped) > 1 else 0.02
        if begin <= seconds <= end or apart <= half_step:
            return index
    return None
