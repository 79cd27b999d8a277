"""`streamkit experiments`: repeats the published experiments and writes tables, figures and JSON."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from streamkit import exit_with_error, needs_extra

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FRAME_NS = 40_000_000
DESCRIPTION = (
    "appsrc name=in max-buffers={frames} ! waveleteigen model={model} learn=false "
    "! particletrack compare=features auto-start=false window={window} particles=120 keep=12 "
    "size-particles=4 angle-particles=4 coast=60 lost-frames=1000 lost-threshold=0 ! appsink name=out"
)


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
    from streamkit_wavelet_eigen.experiments.page import draw_figure_3, page
    from streamkit_wavelet_eigen.experiments.run import run_all
    from streamkit_wavelet_eigen.experiments.splits import MissingData, data_folder

    began = time.monotonic()

    def report(key: str) -> None:
        typer.echo(f"{key} done after {time.monotonic() - began:.0f} s", err=True)

    try:
        folder = data_folder(data)
        output.mkdir(parents=True, exist_ok=True)
        typer.echo("running; each part says when it is done, the first takes minutes", err=True)
        with needs_extra("streamkit experiments", "experiments"):
            results = run_all(
                folder,
                follow_target,
                repetitions=repetitions,
                tracking_runs=tracking_runs,
                workers=workers,
                report=report,
            )
        text = json.dumps(results, indent=1) + "\n"
        (output / "paper-tables.json").write_text(text, encoding="utf-8")
        (output / "paper-tables.md").write_text(page(results), encoding="utf-8")
        if plots:
            with needs_extra("--plots", "experiments"):
                draw_figure_3(results, output / "paper-figure-3.svg")
    except (MissingData, OSError) as error:
        exit_with_error(str(error))
    typer.echo(f"{output / 'paper-tables.md'}, .json{' and figure 3' if plots else ''} written")


def follow_target(
    frames: NDArray[np.uint8], model: Path, centre: NDArray[np.float64], side: int
) -> NDArray[np.float64]:
    """The target's centre in each frame, float64[n, 2] px, as reported by waveleteigen and particletrack.

    Where the target is not reported its last reported position counts.

    Args:
        frames: uint8[n, h, w].
        model: model file of waveleteigen.
        centre: of the target in the first frame, float64[2] px.
        side: of the target's window, px.
    """
    import numpy as np

    from streamkit import Pipeline, Tracks, TrackState, raw_video_caps

    left, top = centre - (side - 1) / 2
    window = f"{left:.0f},{top:.0f},{side},{side}"
    text = DESCRIPTION.format(frames=len(frames), model=model, window=window)
    with Pipeline.parse(text) as pipeline:
        pipeline["in"].caps = raw_video_caps("GRAY8", frames.shape[2], frames.shape[1])
        pipeline.play()
        for index, image in enumerate(frames):
            pipeline["in"].push(image, pts=index * FRAME_NS)
        pipeline["in"].end()
        reported = [frame.get(Tracks) for frame in pipeline["out"]]
    found = np.empty((len(reported), 2))
    for index, tracks in enumerate(reported):
        alive = [row for row in (tracks.tracks if tracks else ()) if row.state is not TrackState.LOST]
        found[index] = (alive[0].x, alive[0].y) if alive else found[index - 1] if index else centre
    return found
