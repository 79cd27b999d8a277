"""The command `streamkit trackeval`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from streamkit_tracker.evaluation.boxes import LEAST_OVERLAP, without_distractors
from streamkit_tracker.evaluation.hota import score_hota
from streamkit_tracker.evaluation.identities import score_identities
from streamkit_tracker.evaluation.one_pass import one_pass
from streamkit_tracker.evaluation.readers import (
    frames_of,
    frames_with_boxes,
    is_one_target,
    longest_lived,
    read_boxes,
    read_classes,
    read_identities,
    read_tracks,
)


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
        float, typer.Option(min=0.01, max=1.0, help="Overlap from which a track matches a truth.")
    ] = 0.5,
    first_pixel: Annotated[
        float, typer.Option(help="Number of the first pixel in the truth: 1 as published, or 0.")
    ] = 1.0,
    frames: Annotated[
        str | None,
        typer.Option(help="FIRST:LAST, from 1; without it, from the truth's first frame to its last."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Scores tracks against ground truth: HOTA, MOTA and IDF1, or success and precision of one target.

    Truth with classes (MOT16 and later) is scored for pedestrians; tracks of distractors are left out.
    """
    try:
        wanted = None if frames is None else frame_range(frames)
    except ValueError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from error
    try:
        scores = score_files(tracks, truth, overlap, first_pixel, wanted)
    except (ValueError, UnicodeDecodeError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from error
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
    words = text.split(":")
    if len(words) != 2 or not all(word.isascii() and word.isdigit() for word in words):
        raise ValueError(f"--frames takes FIRST:LAST, got {text!r}; for example --frames 1:69")
    first, last = int(words[0]), int(words[1])
    if not 1 <= first <= last:
        raise ValueError(f"--frames: the first frame is 1 or later and not behind the last, got {text!r}")
    return first, last


def score_files(
    tracks: Path,
    truth: Path,
    overlap: float = LEAST_OVERLAP,
    first_pixel: float = 1.0,
    frames: tuple[int, int] | None = None,
) -> dict[str, float]:
    """The scores of a file of tracks by their names; see `trackeval`.

    Raises:
        ValueError: a file is not what it should be.
    """
    found = read_tracks(tracks)
    if is_one_target(truth):
        boxes = read_boxes(truth, first_pixel)
        first, last = frames or (1, len(boxes))
        single = one_pass(longest_lived(found, len(boxes))[first - 1 : last], boxes[first - 1 : last])
        return {
            "success": single.success,
            "precision": single.precision,
            "centre_error": single.centre_error,
            "frames": single.frames,
        }
    true = read_identities(truth, first_pixel)
    first, last = frames or frames_with_boxes(true)
    true, found = frames_of(true, first, last), frames_of(found, first, last)
    if frames and not any(len(boxes.ids) for boxes in true):
        raise ValueError(f"--frames {first}:{last}: the truth has no box there; name frames that it covers")
    if classes := read_classes(truth, first_pixel):
        found = without_distractors(found, frames_of(classes, first, last))
    many, higher_order = score_identities(true, found, overlap), score_hota(true, found)
    return {
        "hota": higher_order.hota,
        "detection_accuracy": higher_order.detection,
        "association_accuracy": higher_order.association,
        "mota": many.mota,
        "idf1": many.idf1,
        "switches": many.switches,
        "misses": many.misses,
        "false_alarms": many.false_alarms,
        "truths": many.truths,
        "overlap": many.overlap,
        "frames": len(true),
    }
