"""The command `streamkit explain`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NamedTuple, NoReturn

import typer

from streamkit_tracker.associate.gated_pairs import GATE
from streamkit_tracker.explanation.life import life, moment_at, moment_in
from streamkit_tracker.explanation.moment import Moment
from streamkit_tracker.explanation.reading import TrackFile, read_track
from streamkit_tracker.explanation.wording import explanation

MOST_NAMED = 12


class Question(NamedTuple):
    """Which track, and when: at seconds, or in a frame."""

    track: int
    seconds: float | None
    frame: int | None


def explain(
    tracks: Annotated[
        Path, typer.Argument(help="JSON lines from tracksink.", exists=True, dir_okay=False, readable=True)
    ],
    moment: Annotated[
        str, typer.Argument(metavar="ID@SECONDS", help="Track and time, 7@2.4; or track and frame, 7#60.")
    ],
    before: Annotated[int, typer.Option(min=0, help="Frames up to then that are listed one by one.")] = 10,
    epoch: Annotated[
        int | None, typer.Option(min=0, help="Of the seconds, where a feed was interrupted.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Tells where a track came from: its detections, their distance, its similarity, the registration."""
    question = read_question(moment)
    if question is None:
        _fail(f"{moment!r} must be ID@SECONDS or ID#FRAME, for example 7@2.4 or 7#60", code=2)
    try:
        file = read_track(tracks, question.track)
    except (OSError, ValueError) as error:
        _fail(str(error))
    index = _index(file, question, epoch)
    if index is None:
        _fail(absence(tracks, file, question))
    if file.cut_off:
        typer.echo(f"explain: the last line of {tracks} is only half written and left out", err=True)
    if as_json:
        typer.echo(json.dumps(_plain(question.track, file.moments, index)))
        return
    for line in explanation(question.track, file.moments, index, before, math.sqrt(GATE)):
        typer.echo(line)


def read_question(text: str) -> Question | None:
    """Track and time of "7@2.4" or "7#60"; None where it is neither."""
    for sign in "@#":
        track, parted, when = text.partition(sign)
        if not parted:
            continue
        try:
            number, value = int(track), float(when.removesuffix("s")) if sign == "@" else int(when)
        except ValueError:
            return None
        if number < 0 or not math.isfinite(value):
            return None
        return Question(number, float(value), None) if sign == "@" else Question(number, None, int(value))
    return None


def absence(path: Path, file: TrackFile, question: Question) -> str:
    """Why there is nothing to explain, and what could be asked instead."""
    if not file.frames:
        return f"{path}: no record in it"
    if file.moments:
        first, last = file.moments[0], file.moments[-1]
        return (
            f"track {question.track} is not there then; it is from {first.when} to {last.when} "
            f"(frames {first.frame} to {last.frame}, epochs {first.epoch} to {last.epoch})"
        )
    named = ", ".join(str(number) for number in sorted(file.others)[:MOST_NAMED])
    more = ", ..." if len(file.others) > MOST_NAMED else ""
    there = f"confirmed were {named}{more}" if file.others else "no track was ever confirmed"
    return f"{path}: no track {question.track} in {file.frames} records; {there}"


def _index(file: TrackFile, question: Question, epoch: int | None) -> int | None:
    if question.seconds is not None:
        return moment_at(file.moments, question.seconds, epoch)
    return None if question.frame is None else moment_in(file.moments, question.frame)


def _plain(track: int, moments: Sequence[Moment], index: int) -> dict[str, object]:
    return {
        "track": track,
        "moment": asdict(moments[index]),
        "life": asdict(life(moments[: index + 1])),
    }


def _fail(text: str, code: int = 1) -> NoReturn:
    typer.echo(f"explain: {text}", err=True)
    raise typer.Exit(code)
