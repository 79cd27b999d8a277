"""The command `streamkit trackeval`."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from streamkit import SHOWN_STATES, StreamError, exit_with_error
from streamkit_tracks.evaluation.readers import (
    evidence_of_swap,
    frames_of,
    frames_with_boxes,
    is_one_target,
    longest_lived,
    read_boxes,
    read_tracks,
    read_truth,
    sides,
    tracks_by_frame,
)
from streamkit_tracks.evaluation.scores import (
    MIN_OVERLAP,
    Labelled,
    one_pass,
    score_hota,
    score_identities,
    without_distractors,
)
from streamkit_tracks.recorded_runs import RunOption, choose_run, records_of


def trackeval(
    tracks: Annotated[
        Path,
        typer.Argument(help="From tracksink: JSON lines, MOT text or CSV.", exists=True, dir_okay=False),
    ],
    truth: Annotated[
        Path,
        typer.Argument(
            help="Ground truth: MOT text, or left,top,width,height a line for one target.",
            exists=True,
            dir_okay=False,
        ),
    ],
    overlap: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="For MOTA and IDF1: the overlap that makes a match.")
    ] = MIN_OVERLAP,
    first_pixel: Annotated[
        float, typer.Option(help="Number of the first pixel in the truth: 1 as published, or 0.")
    ] = 1.0,
    frames: Annotated[
        str | None,
        typer.Option(help="FIRST:LAST, from 1; without it, from the truth's first frame to its last."),
    ] = None,
    run: RunOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Scores tracks against ground truth: HOTA, MOTA and IDF1, or success and precision of one target.

    Truth with classes (MOT16 and later) is scored for pedestrians; tracks of distractors are left out.
    """
    try:
        limits = None if frames is None else frame_range(frames)
    except ValueError as error:
        exit_with_error(str(error), 2)
    try:
        scores = score_files(tracks, truth, overlap, first_pixel, limits, run)
        evidence = evidence_of_swap(tracks, truth)
    except (ValueError, StreamError) as error:
        exit_with_error(str(error))
    if evidence:
        typer.echo(f"warning: {evidence}; tracks come first, ground truth second", err=True)
    if as_json:
        typer.echo(json.dumps(scores))
        return
    for name, value in scores.items():
        typer.echo(f"{name:<20} {value:.3f}" if isinstance(value, float) else f"{name:<20} {value}")


def frame_range(text: str) -> tuple[int, int]:
    """First and last frame of "FIRST:LAST".

    Raises:
        ValueError: it is something else.
    """
    words = re.fullmatch(r"(\d+):(\d+)", text, re.ASCII)
    if words is None:
        raise ValueError(f"--frames takes FIRST:LAST, got {text!r}; for example --frames 1:69")
    first, last = int(words[1]), int(words[2])
    if not 1 <= first <= last:
        raise ValueError(f"--frames: the first frame is 1 or later and not behind the last, got {text!r}")
    return first, last


def read_run(path: Path, number: int | None) -> list[Labelled]:
    """The tracks of one run of JSON lines for each frame from 1; raises as `choose_run`."""
    rows = [
        (record.seq + 1, target.id, sides(target.bbox))
        for record in records_of(path, choose_run(path, number))
        for target in record.tracks
        if target.state in SHOWN_STATES
    ]
    return tracks_by_frame(path, rows)


def score_files(
    tracks: Path,
    truth: Path,
    overlap: float = MIN_OVERLAP,
    first_pixel: float = 1.0,
    frames: tuple[int, int] | None = None,
    run: int | None = None,
) -> dict[str, float | int]:
    """The scores of a file of tracks by their names; see `trackeval`.

    Raises:
        ValueError: a file is not what it should be.
        StreamError: a line is no track record, or there is no such run.
    """
    found = read_tracks(tracks) if tracks.suffix in (".txt", ".csv") else read_run(tracks, run)
    if is_one_target(truth):
        boxes = read_boxes(truth, first_pixel)
        first, last = frames or (1, len(boxes))
        if frames is None:
            _note_longer(found, last)
        single = one_pass(longest_lived(found, len(boxes))[first - 1 : last], boxes[first - 1 : last])
        if not single.success:
            _note_no_match(found, first, last)
        return asdict(single)
    targets, classes = read_truth(truth, first_pixel)
    first, last = frames or frames_with_boxes(targets)
    if frames is None:
        _note_longer(found, last)
    tracked = found
    targets, found = frames_of(targets, first, last), frames_of(found, first, last)
    if frames and not any(len(boxes.ids) for boxes in targets):
        raise ValueError(f"--frames {first}:{last}: the truth has no box there; name frames that it covers")
    if classes:
        found = without_distractors(found, frames_of(classes, first, last))
    higher_order, identities = score_hota(targets, found), score_identities(targets, found, overlap)
    if identities.misses == identities.truths:
        _note_no_match(tracked, first, last)
    return asdict(higher_order) | asdict(identities) | {"frames": len(targets)}


def _note_longer(found: list[Labelled], last: int) -> None:
    """Notes on the standard error output that tracks go on behind the last frame that is scored."""
    tracked = max((number for number, boxes in enumerate(found, 1) if len(boxes.ids)), default=0)
    if tracked > last:
        text = f"the tracks go on to frame {tracked}, the truth ends with {last}: the rest is not scored"
        typer.echo(f"note: {text}", err=True)


def _note_no_match(tracked: list[Labelled], first: int, last: int) -> None:
    """Notes on the standard error output why no track matches the truth in the frames that are scored."""
    begin, end = frames_with_boxes(tracked)
    if end < begin:
        text = "there is no track in the whole file"
    elif not any(len(boxes.ids) for boxes in tracked[first - 1 : last]):
        text = f"the tracks are in frames {begin} to {end}, scored are {first} to {last}"
    else:
        text = "are both of the same video, in pixels of the same size, its first frame being 1?"
    typer.echo(f"note: no track matches the truth: {text}", err=True)
