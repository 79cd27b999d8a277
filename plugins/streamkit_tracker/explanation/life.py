"""What a track's moments come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from streamkit_tracker.explanation.moment import Moment


@dataclass(frozen=True)
class Life:
    """A track up to a moment.

    Attributes:
        frames: in which it has a row.
        detected: of these, with a detection of its own.
        shared: of these, with the detection of another track that covers this one.
        gates: median and largest distance of its detections, standard deviations, or None.
        similarities: median and least similarity, or None.
        learnt: frames its look was learnt from.
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
    """The moments in which something was decided, or the state changed from the one before.

    Args:
        moments: in order.
        state: before the first of them; None where there was none.
    """
    found = []
    for moment in moments:
        target = moment.target
        decided = target.provenance is not None and bool(target.provenance.cause)
        if decided or target.state != state:
            found.append(moment)
        state = target.state
    return tuple(found)


def _gaps(moments: Sequence[Moment]) -> tuple[tuple[int, int], ...]:
    gaps: list[tuple[int, int]] = []
    open_gap = False
    for moment in moments:
        origin = moment.target.provenance
        if origin is not None and (origin.detection is not None or origin.shared):
            open_gap = False
        elif open_gap:
            gaps[-1] = (gaps[-1][0], moment.frame)
        else:
            gaps.append((moment.frame, moment.frame))
            open_gap = True
    return tuple(gaps)


def moment_at(moments: Sequence[Moment], seconds: float, epoch: int | None) -> int | None:
    """Index of the moment nearest to a time, or None where the track is not there at that time.

    Args:
        moments: of the track, in order.
        seconds: time in the stream.
        epoch: to look in, or None for the first in which the track is there then.
    """
    epochs = sorted({moment.epoch for moment in moments}) if epoch is None else [epoch]
    for wanted in epochs:
        stamped = [
            (moment.seconds, index)
            for index, moment in enumerate(moments)
            if moment.epoch == wanted and moment.seconds is not None
        ]
        if not stamped:
            continue
        apart, index = min((abs(at - seconds), index) for at, index in stamped)
        if stamped[0][0] <= seconds <= stamped[-1][0] or apart <= _half_step(stamped):
            return index
    return None


def _half_step(stamped: Sequence[tuple[float, int]]) -> float:
    """Half the usual time between two moments, s; a time as near as that to an end is still inside."""
    if len(stamped) < 2:
        return 0.02
    return (stamped[-1][0] - stamped[0][0]) / (len(stamped) - 1) / 2 + 1e-9
