"""The command `streamkit doctor`."""

from __future__ import annotations

import json
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.markup import escape

from streamkit.output.colour import coloured
from streamkit_media.doctor.examine import examine


def doctor(
    uri: Annotated[str, typer.Argument(help="rtsp://..., udp://..., another live stream, or a file.")],
    seconds: Annotated[float, typer.Option(min=0.5, max=3600, help="How long to watch a live stream.")] = 5.0,
    timeout_s: Annotated[
        float, typer.Option("--timeout", min=0.1, max=600, help="Silence that is given up, s.")
    ] = 5.0,
    transport: Annotated[
        Literal["tcp", "udp", "auto"], typer.Option(help="Of RTSP; auto is udp, or tcp where nothing comes.")
    ] = "tcp",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Checks a stream or file and gives a pipeline to begin with; exit 1 where it cannot be used."""
    with Console(stderr=True).status("") as status:  # shows on a terminal only
        report = examine(uri, seconds, timeout_s, transport, lambda step: status.update(escape(step)))
    typer.echo(json.dumps(report.as_json(), indent=2) if as_json else coloured(report.as_text()))
    if not report.is_usable:
        raise typer.Exit(1)
