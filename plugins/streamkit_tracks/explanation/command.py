"""The command `streamkit explain`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import typer

from streamkit import StreamError, TrackState, exit_with_error
from streamkit.output.pipe import until_reader_leaves
from streamkit_tracks.explanation.history import Moment, life, moment_at
from streamkit_tracks.explanation.wording import explanation
from streamkit_tracks.recorded_runs import RecordsOrStandardInput, choose_run, named_file, records_of

MAX_NAMED = 12
GATE = 4.0  # of particletrack, standard deviations


class Question(NamedTuple):
    """Which track, and when: at seconds, in a frame, or in its last frame."""

    track: int
    seconds: float | None
    frame: int | None


def explain(
    tracks: RecordsOrStandardInput,
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
        with named_file(tracks) as path:
            file = read_track(path, question.track, run, tracks)
    except (OSError, StreamError) as error:
        exit_with_error(str(error))
    index = _index(file, question, epoch)
    if index is None:
        exit_with_error(absence(tracks, file, question))
    with until_reader_leaves():
        if as_json:
            typer.echo(msgspec.json.encode(_plain(question.track, file.moments, index)).decode())
            return
        for line in explanation(question.track, file.moments, index, before, GATE):
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


def read_track(path: Path, number: int, run: int | None = None, name: Path | None = None) -> TrackFile:
    """Reads what a run of a file says about a track; by default the last run that has it.

    Raises:
        OSError, StreamError: see `choose_run`.
    """
    found = TrackFile()
    chosen = choose_run(path, run, name, lambda record: any(row.id == number for row in record.tracks))
    for record in records_of(path, chosen):
        found.frames += 1
        seconds = None if record.pts_ns is None else record.pts_ns / 1e9
        for target in record.tracks:
            if target.state is TrackState.CONFIRMED:
                found.others.add(target.id)
            if target.id == number:
                found.moments.append(Moment(record.seq, record.epoch, seconds, record.registration, target))
    return found


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
