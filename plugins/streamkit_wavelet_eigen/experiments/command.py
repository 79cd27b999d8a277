"""`streamkit experiments`: repeats the published experiments and writes tables, figures and JSON."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer


def experiments(
    data: Annotated[
        Path | None, typer.Option(help="Folder with orl/ and coil20/; STREAMKIT_DATA if not given.")
    ] = None,
    output: Annotated[Path, typer.Option(help="Folder to write into.")] = Path("out/experiments"),
    workers: Annotated[int, typer.Option(min=1, max=16, help="Processes.")] = 2,
    repetitions: Annotated[int, typer.Option(min=2, max=10, help="Random splits of each partition.")] = 10,
    tracking_runs: Annotated[int, typer.Option(min=10, max=100, help="Sequences of tables 2 and 4.")] = 100,
    plots: Annotated[bool, typer.Option(help="Draw figure 3 (needs the extra `experiments`).")] = True,
) -> None:
    """Repeats the publication's experiments on ORL and COIL-20: tables 1 to 4, figure 3, and peers."""
    from streamkit_wavelet_eigen.experiments.databases import MissingData, data_folder
    from streamkit_wavelet_eigen.experiments.page import page
    from streamkit_wavelet_eigen.experiments.run import run_all

    began = time.monotonic()

    def report(key: str) -> None:
        typer.echo(f"{key} done after {time.monotonic() - began:.0f} s", err=True)

    try:
        folder = data_folder(data)
        output.mkdir(parents=True, exist_ok=True)
        results = run_all(
            folder, repetitions=repetitions, tracking_runs=tracking_runs, workers=workers, report=report
        )
        text = json.dumps(results, indent=1) + "\n"
        (output / "paper-tables.json").write_text(text, encoding="utf-8")
        (output / "paper-tables.md").write_text(page(results), encoding="utf-8")
        if plots:
            from streamkit_wavelet_eigen.experiments.plots import draw_figure_3

            draw_figure_3(results, output / "paper-figure-3.svg")
    except (MissingData, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from error
    except ImportError as error:
        typer.echo(f"error: {error}; install the extra: pip install 'streamkit[experiments]'", err=True)
        raise typer.Exit(1) from error
    typer.echo(f"{output / 'paper-tables.md'}, .json{' and figure 3' if plots else ''} written")
