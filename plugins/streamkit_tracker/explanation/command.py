"""The command `streamkit explain`."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import typer

from streamkit import RecordFile, StreamError, TrackRecord, exit_with_error
from streamkit.output.pipe import STANDARD_INPUT, until_reader_leaves
from streamkit_tracker.associate import GATE
from streamkit_tracker.explanation.history import FramePlace, Moment, Target, life, moment_at
from streamkit_tracker.explanation.wording import explanation

MAX_NAMED = 12
STANDARD_INPUT_FILE = Path("/dev/stdin")


class Question(NamedTuple):
    """Which track, and when: at seconds, in a frame, or in its last frame."""

    track: int
    seconds: float | None
    frame: int | None


def explain(
    tracks: Annotated[
        Path,
        typer.Argument(
            help="JSON lines from tracksink; - is the standard input.",
            exists=True,
            dir_okay=False,
            readable=True,
            allow_dash=True,
        ),
    ],
    moment: Annotated[
        str,
        typer.Argument(
            metavar="ID@SECONDS",
            help="Track and time, 7@2.4; or track and frame, 7#60; or its whole life, 7.",
        ),
    ],
    before: Annotated[int, typer.Option(min=0, help="Frames up to then that are listed one by one.")] = 10,
    epoch: Annotated[
        int | None, typer.Option(min=0, help="Of the seconds, where a feed was interrupted.")
    ] = None,
    run: Annotated[
        int | None,
        typer.Option(min=1, help="Of a file with several runs; without it, the last that has the track."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Explains where a track came from: its detections, their distance, its similarity, the registration."""
    question = read_question(moment)
    if question is None:
        exit_with_error(
            f"{moment!r} must be ID@SECONDS or ID#FRAME, for example 7@2.4 or 7#60, or ID", code=2
        )
    try:
        file = read_track(
            STANDARD_INPUT_FILE if str(tracks) == STANDARD_INPUT else tracks, question.track, run
        )
    except (OSError, StreamError, ValueError) as error:
        exit_with_error(str(error))
    index = _index(file, question, epoch)
    if index is None:
        exit_with_error(absence(tracks, file, question))
    with until_reader_leaves():
        if as_json:
            typer.echo(msgspec.json.encode(_plain(question.track, file.moments, index)).decode())
            return
        for line in explanation(question.track, file.moments, index, before, math.sqrt(GATE)):
            typer.echo(line)


def read_question(text: str) -> Question | None:
    """Track and time of "7@2.4", "7#60" or "7"; None where it is none of these."""
    parts = re.fullmatch(r"(\d+)(?:@(\d*\.?\d+)s?|#(\d+))?", text, re.ASCII)
    if parts is None:
        return None
    track, seconds, frame = parts.groups()
    return Question(int(track), float(seconds) if seconds else None, int(frame) if frame else None)


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
    named = ", ".join(str(number) for number in sorted(file.others)[:MAX_NAMED])
    more = ", ..." if len(file.others) > MAX_NAMED else ""
    there = f"confirmed were {named}{more}" if file.others else "no track was ever confirmed"
    return f"{path}: no track {question.track} in {file.frames} records; {there}"


@dataclass
class TrackFile:
    """What one run of a file says about one track.

    Attributes:
        moments: of the track, in the order of the file.
        others: ids of all tracks that were ever confirmed.
        frames: number of records.
    """

    moments: list[Moment] = field(default_factory=list)
    others: set[int] = field(default_factory=set)
    frames: int = 0


def read_track(path: Path, number: int, run: int | None = None) -> TrackFile:
    """Reads a file of JSON lines as `tracksink` writes it.

    Args:
        path: the file.
        number: id of the track.
        run: which run; None is the last that has the track, else the last, and a note on the standard error
            output tells which of several it is.

    Raises:
        OSError: the file cannot be read.
        StreamError: a line is no track record; names file and line.
        ValueError: there is no such run.
    """
    runs, records = [TrackFile()], RecordFile(path)
    for of_run, record in records:
        if of_run > len(runs):
            runs.append(TrackFile())
        runs[of_run - 1].frames += 1
        runs[of_run - 1].others |= {target.id for target in record.tracks if target.state == "confirmed"}
        runs[of_run - 1].moments += [
            _moment(record, target) for target in record.tracks if target.id == number
        ]
    if run is not None and run > len(runs):
        raise ValueError(f"{path}: no run {run}, it has {len(runs)}")
    with_track = [index for index, found in enumerate(runs, 1) if found.moments]
    chosen = run or (with_track or [len(runs)])[-1]
    if run is None and len(runs) > 1:
        typer.echo(f"note: {path} has {len(runs)} runs, this is run {chosen}; see --run", err=True)
    if records.is_cut_off:
        typer.echo(f"note: the last line of {path} is only half written and left out", err=True)
    return runs[chosen - 1]


def _moment(record: TrackRecord, target: object) -> Moment:
    seconds = None if record.pts_ns is None else record.pts_ns / 1e9
    place = msgspec.convert(record.registration, FramePlace | None, from_attributes=True)
    return Moment(
        record.seq, record.epoch, seconds, place, msgspec.convert(target, Target, from_attributes=True)
    )


def _index(file: TrackFile, question: Question, epoch: int | None) -> int | None:
    if question.seconds is not None:
        return moment_at(file.moments, question.seconds, epoch)
    if question.frame is None:
        return len(file.moments) - 1 if file.moments else None
    return next((i for i, moment in enumerate(file.moments) if moment.frame == question.frame), None)


def _plain(track: int, moments: Sequence[Moment], index: int) -> object:
    moment = moments[index]
    head = {"frame": moment.frame, "epoch": moment.epoch, "seconds": moment.seconds, "place": moment.place}
    row = {**head, **msgspec.structs.asdict(moment.target), "match": moment.match}
    return {"track": track, "moment": row, "life": asdict(life(moments[: index + 1]))}
