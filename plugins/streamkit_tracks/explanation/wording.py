"""Puts a track's moment and its life so far in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from streamkit import RegistrationRecord
from streamkit_tracks.explanation.history import Life, Moment, life, turns

MAX_LISTED = 6
SILENT = "the file has no provenance: write it with tracksink provenance=true, behind particletrack"


def explanation(number: int, moments: Sequence[Moment], index: int, before: int, gate: float) -> list[str]:
    """The lines that explain a track at a moment.

    Args:
        number: id of the track.
        moments: of the track, in order.
        index: of the moment.
        before: frames up to the moment that are listed one by one.
        gate: largest distance of a detection that need not lie upon the track, standard deviations.
    """
    moment = moments[index]
    lines = [f"track {number} at {moment.when}: frame {moment.frame}, epoch {moment.epoch}"]
    lines += [f"  {name:<13}{text}" for name, text in _facts(moment, gate)]
    lines += ["", "since it began"]
    lines += [f"  {line}" for line in _life_lines(life(moments[: index + 1]))]
    later = turns(moments[index + 1 :], moment.target.state)
    lines += ["", "after that"] if later else []
    lines += [f"  {line}" for line in _listed([_turn(turn) for turn in later])]
    if before:
        lines += ["", *_table(moments[max(0, index + 1 - before) : index + 1])]
    return lines


def _facts(moment: Moment, gate: float) -> list[tuple[str, str]]:
    target, spread, speed = moment.target, "", "not known"
    if target.position_covariance is not None:
        x_std, y_std = (math.sqrt(max(target.position_covariance[axis][axis], 0.0)) for axis in (0, 1))
        spread = f", +- {x_std:.1f} {y_std:.1f} px"
    if target.vx is not None and target.vy is not None:
        speed = f"{target.vx:.1f} {target.vy:.1f} px/s on the reference plane"
    size = f"{target.length:.1f} x {target.width:.1f} px at {math.degrees(target.angle):.1f} deg"
    facts = [
        ("state", f"{target.state}, {target.age_ns / 1e9:.2f} s old, score {target.score:.2f}"),
        ("place", f"{target.x:.1f} {target.y:.1f} px{spread}; {size}"),
        ("velocity", speed),
        ("registration", _place_text(moment.place)),
    ]
    return facts + _origin_facts(moment, gate)


def _origin_facts(moment: Moment, gate: float) -> list[tuple[str, str]]:
    origin, match = moment.target.provenance, moment.match
    if origin is None:
        return [("origin", SILENT)]
    facts = []
    if origin.predicted is not None:
        facts.append(("expected", f"{origin.predicted[0]:.1f} {origin.predicted[1]:.1f} px"))
    if match is not None:
        distance = "" if match.gate is None else f", {_distance_text(match.gate, gate)}"
        label = f", {match.label}" if match.label else ""
        box = " ".join(f"{side:.1f}" for side in match.bbox)
        x, y = match.centroid
        facts.append(("detection", f"row {match.row} at {x:.1f} {y:.1f} px{distance}"))
        facts.append(("", f"box {box}, area {match.area:.0f} px, score {match.score:.2f}{label}"))
        if origin.shared:
            facts.append(("", "it covers another track, too"))
    else:
        missing = "that of another track covers this one too" if origin.shared else "none in its gate"
        facts.append(("detection", missing))
    compared = "not compared: it was not searched, or the frame could not be placed"
    if match is not None:
        compared = "not compared: its detection is enough in this frame, or its appearance is not known yet"
    if origin.similarity is not None:
        learnt = "learnt from this frame" if origin.learnt else "not learnt from this frame"
        compared = f"{origin.similarity:.3f} to its template; {learnt}"
    facts.append(("similarity", compared))
    if origin.cause:
        facts.append(("decided", origin.cause))
    return facts


def _distance_text(distance: float, gate: float) -> str:
    inside = f"gate {gate:g}" if distance <= gate else f"outside the gate of {gate:g}, but upon the target"
    return f"{distance:.2f} deviations away ({inside})"


def _place_text(place: RegistrationRecord | None) -> str:
    if place is None:
        return "none: the camera is taken to stand still"
    text = f"{place.status}, plane {place.reference}"
    if place.inliers is not None and place.matches is not None:
        text += f", {place.inliers} of {place.matches} points agree"
    return text if place.rmse is None else f"{text}, rmse {place.rmse:.2f} px"


def _life_lines(past: Life) -> list[str]:
    lines = _listed([_turn(turn) for turn in past.turns])
    lines.append(f"detected in {past.detected} of {past.frames} frames")
    if past.shared:
        lines[-1] += f", in {past.shared} through another track's detection"
    if past.gates is not None:
        lines.append(f"distance of its detections: median {past.gates[0]:.2f}, largest {past.gates[1]:.2f}")
    if past.similarities is not None:
        middle, least = past.similarities
        lines.append(f"similarity: median {middle:.3f}, least {least:.3f}; learnt from {past.learnt} frames")
    if past.gaps:
        gaps = [str(a) if a == b else f"{a}-{b}" for a, b in past.gaps]
        lines.append("not detected in frames " + ", ".join(_listed(gaps)))
    if past.registrations:
        counts = ", ".join(f"{status} {count}" for status, count in past.registrations.items())
        planes = ", ".join(str(plane) for plane in past.planes)
        lines.append(f"registration: {counts}; plane {planes}")
    return lines


def _turn(moment: Moment) -> str:
    origin, state = moment.target.provenance, moment.target.state
    cause = f": {origin.cause}" if origin is not None and origin.cause not in (None, "", state) else ""
    return f"frame {moment.frame}, {moment.when}: {state}{cause}"


def _listed(lines: list[str]) -> list[str]:
    """The lines, those in the middle left out where there are many."""
    if len(lines) <= MAX_LISTED:
        return lines
    half = MAX_LISTED // 2
    return [*lines[:half], f"... {len(lines) - 2 * half} more ...", *lines[-half:]]


def _table(moments: Sequence[Moment]) -> list[str]:
    lines = ["   frame          s  state      detection  distance  similarity  registration"]
    for moment in moments:
        origin, match = moment.target.provenance, moment.match
        row = gate = similarity = "-"
        if match is not None:
            row, gate = str(match.row), "-" if match.gate is None else f"{match.gate:.2f}"
        if origin is not None:
            row = "shared" if origin.shared else row
            similarity = "-" if origin.similarity is None else f"{origin.similarity:.3f}"
        seconds = "-" if moment.seconds is None else f"{moment.seconds:.3f}"
        status = "-" if moment.place is None else moment.place.status
        lines.append(
            f"{moment.frame:8d} {seconds:>10}  {moment.target.state:<9} {row:>10} {gate:>9} {similarity:>11}"
            f"  {status}"
        )
    return lines
