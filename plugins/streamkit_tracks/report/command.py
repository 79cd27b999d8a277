"""The command `streamkit report`."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from streamkit import (
    CONTAINER_ROUNDING_NS,
    Pipeline,
    StreamError,
    StreamkitError,
    exit_with_error,
    needs_extra,
    read_statistics,
)
from streamkit.masking import presentable
from streamkit_tracks.recorded_runs import (
    RecordsArgument,
    RunOption,
    choose_run,
    reason,
    records_of,
    write_output,
)
from streamkit_tracks.report.page import build_page, cost_table
from streamkit_tracks.report.run_data import RecordedRun, TargetPath

MAX_CROPS = 60
PAGE_SUFFIXES = (".html", ".htm")


def report(
    file: RecordsArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="Page to write.")] = Path("report.html"),
    video: Annotated[
        Path | None, typer.Option(help="The video that the tracks are of: adds pictures of the targets.")
    ] = None,
    stats: Annotated[
        Path | None,
        typer.Option(help="Counters of the run from launch --stats-file: adds each element's cost."),
    ] = None,
    run: RunOption = None,
) -> None:
    """Writes a page about a finished run: map, time line of the targets, age, registration, pictures."""
    if output.suffix.lower() not in PAGE_SUFFIXES:
        exit_with_error(f"--output must end in .html, got {output}; a browser prints it as PDF", code=2)
    try:
        found = RecordedRun()
        for record in records_of(file, choose_run(file, run)):
            found.add(record)
        costs = "" if stats is None else cost_table(read_statistics(stats))
        frame, crops = (b"", {}) if video is None else take_pictures(found, video)
        write_page(found, file.name, output, frame, crops, costs)
    except (OSError, StreamkitError) as error:
        exit_with_error(reason(error))
    typer.echo(f"wrote {output}")


def write_page(
    run: RecordedRun, title: str, output: Path, frame: bytes, crops: dict[int, bytes], costs: str
) -> None:
    """Writes the page.

    Raises:
        ResourceError: matplotlib is not installed, or the page cannot be written.
    """
    with needs_extra("the report", "report"):
        from streamkit_tracks.report.figures import draw_figures

    page = build_page(run, title, draw_figures(run), frame, crops, costs)
    write_output(output, page.encode())


def take_pictures(run: RecordedRun, video: Path) -> tuple[bytes, dict[int, bytes]]:
    """The frame with the most targets, and a crop of each of the longest targets where it is largest.

    A frame of the video belongs to the record of the same time, to the millisecond, in which Matroska counts;
    without times, of the same number.

    Raises:
        StreamError: no frame belongs to a record, or frames have another size.
        StreamkitError: the video cannot be read.
    """
    from streamkit_tracks.report.pictures import crop_jpeg, frame_jpeg

    wanted: defaultdict[int, list[TargetPath]] = defaultdict(list, {run.busiest: []})
    for path in run.shown_paths()[:MAX_CROPS]:
        wanted[path.largest[1]].append(path)
    times = sorted((pts, index) for index, pts in enumerate(run.pts_ns) if pts is not None)
    picture, crops, has_match = b"", {}, False
    with Pipeline.parse(
        "filesrc name=file ! decode ! video/x-raw, format=BGR ! appsink name=out"
    ) as pipeline:
        pipeline["file"].location = str(video)
        pipeline.play()
        for number, frame in enumerate(pipeline["out"]):
            index = index_at(times, frame.pts) if times else number
            has_match |= index is not None
            if run.size is not None and frame.data.shape[1::-1] != run.size:
                size = "{} x {}".format(*run.size)
                raise StreamError(f"{video}: the tracks are of frames of {size} px; give their own video")
            if index is None or index not in wanted:
                continue
            if index == run.busiest:
                picture = frame_jpeg(frame.data, run.busiest_boxes)
            crops.update({path.id: crop_jpeg(frame.data, path.largest[2]) for path in wanted.pop(index)})
            if not wanted:
                break
    if not has_match:
        raise StreamError(
            f"{video}: no frame has the time of a record; give the video that the tracks are of"
        )
    if lost := sum(map(len, wanted.values())):
        text = f"targets without a picture: {lost}; no frame of {video} has the time of their record"
        typer.echo(presentable(f"note: {text}: give the video that the tracker had"), err=True)
    return picture, crops


def index_at(times: Sequence[tuple[int, int]], pts: int | None) -> int | None:
    """The index beside the time that equals `pts` to rounding, of ascending times (ns) with indices."""
    if pts is None:
        return None
    at = bisect_left(times, (pts - CONTAINER_ROUNDING_NS, 0))
    return times[at][1] if at < len(times) and times[at][0] <= pts + CONTAINER_ROUNDING_NS else None
