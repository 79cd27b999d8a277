"""The command `streamkit trackeval`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from streamkit_tracker.evaluation.identities import score_identities
from streamkit_tracker.evaluation.one_pass import one_pass
from streamkit_tracker.evaluation.readers import (
    is_one_target,
    longest_lived,
    read_boxes,
    read_identities,
    read_tracks,
    same_length,
)


def trackeval(
    tracks: Annotated[
        Path,
        typer.Argument(help="From tracksink: JSON lines or MOT text.", exists=True, dir_okay=False),
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
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Scores tracks against ground truth: MOTA and IDF1, or success and precision of one target."""
    try:
        scores = _scores(tracks, truth, overlap, first_pixel)
    except (ValueError, UnicodeDecodeError) as error:
        typer.echo(f"trackeval: {error}", err=True)
        raise typer.Exit(1) from error
    if as_json:
        typer.echo(json.dumps(scores))
        return
    for name, value in scores.items():
        typer.echo(f"{name:<16} {value:.3f}" if isinstance(value, float) else f"{name:<16} {value}")


def _scores(tracks: Path, truth: Path, overlap: float, first_pixel: float) -> dict[str, float]:
    found = read_tracks(tracks)
    if is_one_target(truth):
        boxes = read_boxes(truth, first_pixel)
        single = one_pass(longest_lived(found, len(boxes)), boxes)
        return {
            "success": single.success,
            "precision": single.precision,
            "centre_error": single.centre_error,
            "frames": single.frames,
        }
    true = read_identities(truth, first_pixel)
    same_length(true, found)
    many = score_identities(true, found, overlap)
    return {
        "mota": many.mota,
        "idf1": many.idf1,
        "switches": many.switches,
        "misses": many.misses,
        "false_alarms": many.false_alarms,
        "truths": many.truths,
        "overlap": many.overlap,
    }
