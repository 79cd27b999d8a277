"""The figures of a report, as SVG."""

from __future__ import annotations

import io
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from streamkit.geometry.earth import metres_per_degree

if TYPE_CHECKING:
    from array import array

    from streamkit_tracks.report.run_data import RecordedRun, TargetPath

# The same bytes for the same run: no date, and fixed element ids.
STYLE: Any = {"svg.hashsalt": "streamkit", "font.size": 8, "path.simplify": True}
STATE_COLOURS = {"tentative": "#bbbbbb", "confirmed": "#1f77b4", "coasting": "#ff7f0e", "lost": "#d62728"}
STATUS_COLOURS = {
    "ok": "#2ca02c", "still": "#98df8a", "weak": "#ffbb33", "cut": "#9467bd", "lost": "#d62728",
}  # fmt: skip
MAX_ROWS = 120
MAX_LABELS = 50  # more cannot be read one below the other
MAX_POINTS = 1000  # of one trail


def draw_figures(run: RecordedRun) -> dict[str, tuple[str, bytes]]:
    """The figures of a run for which it has data.

    Returns:
        By title: what the figure shows, and SVG.

    Raises:
        ImportError: matplotlib is not installed.
    """
    import matplotlib as mpl

    drawn: dict[str, tuple[str, bytes]] = {}
    with mpl.rc_context(STYLE):
        for title, draw, height in (
            ("Map", _draw_map, 5.0),
            ("Targets over time", _draw_targets, 3.6),
            ("Number of targets", _draw_counts, 1.8),
            ("Age and losses", _draw_ages, 1.8),
            ("Registration", _draw_registration, 1.8),
        ):
            figure = _figure(height)
            caption = draw(figure.subplots(), run)
            if caption:
                drawn[title] = caption, _svg(figure)
    return drawn


def _figure(height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(9.0, height), layout="constrained")


def _svg(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "streamkit report"})
    return buffer.getvalue()


def _draw_map(axes: Any, run: RecordedRun) -> str:
    """Trails on the ground in metres, or on the reference plane with the most positions in px."""
    paths = run.shown_paths()
    grounds = [path for path in paths if path.ground]
    plane = run.main_plane()
    if grounds:
        lon, lat = grounds[0].ground[1], grounds[0].ground[2]
        north_m, east_m = metres_per_degree(lat)
        for path in grounds:
            xs, ys = _trail(path.ground)
            east, north = [(x - lon) * east_m for x in xs], [(y - lat) * north_m for y in ys]
            _draw_trail(axes, path, east, north)
        axes.set_xlabel("metres east")
        axes.set_ylabel("metres north")
        caption = f"Trails from {lat:.5f}, {lon:.5f} (WGS84)."
    elif plane is not None:
        for path in paths:
            if plane in path.plane:
                _draw_trail(axes, path, *_trail(path.plane[plane]))
        axes.invert_yaxis()
        axes.set_xlabel("x, px")
        axes.set_ylabel("y, px")
        others = len({number for path in paths for number in path.plane} - {plane})
        caption = f"Trails on reference plane {plane}"
        caption += f"; {others} other planes are not shown." if others else "."
    else:
        return ""
    axes.set_aspect("equal", "datalim")
    return caption + " A dot marks where a target was first confirmed or coasting."


def _trail(points: array[float]) -> tuple[list[float], list[float]]:
    """Coordinates x and y of a path, thinned."""
    step = 3 * max(1, len(points) // 3 // MAX_POINTS)
    return list(points[1::step]), list(points[2::step])


def _draw_trail(axes: Any, path: TargetPath, xs: list[float], ys: list[float]) -> None:
    (line,) = axes.plot(xs, ys, linewidth=1)
    axes.plot(xs[:1], ys[:1], marker="o", markersize=3, color=line.get_color())
    axes.annotate(str(path.id), (xs[0], ys[0]), fontsize=7, color=line.get_color())


def _draw_targets(axes: Any, run: RecordedRun) -> str:
    """A bar for each target, coloured by its state."""
    paths = run.shown_paths()
    rows = sorted(paths[:MAX_ROWS], key=lambda path: path.times_s[0])
    if not rows:
        return ""
    for row, path in enumerate(rows):
        for state, start_s, width_s in _stretches(path.times_s, path.states):
            axes.broken_barh([(start_s, width_s)], (row - 0.4, 0.8), facecolors=STATE_COLOURS[state])
    labelled = range(0, len(rows), -(-len(rows) // MAX_LABELS))
    axes.set_yticks(labelled, [str(rows[row].id) for row in labelled], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel("s")
    axes.set_ylabel("id")
    _legend(axes, STATE_COLOURS)
    left_out = len(paths) - len(rows)
    return "A row for each target that was confirmed" + (
        f"; the {left_out} shortest are left out." if left_out else "."
    )


def _stretches(times_s: array[float], values: list[str]) -> list[tuple[str, float, float]]:
    """Value, start and duration (s) of each stretch of equal values; a pause of over a second parts them."""
    frame_s = min((b - a for a, b in pairwise(times_s) if b > a), default=0.04)
    found: list[tuple[str, float, float]] = []
    for value, time_s in zip(values, times_s, strict=True):
        if found and found[-1][0] == value and time_s - sum(found[-1][1:]) < 1:
            start_s = found[-1][1]
            found[-1] = value, start_s, time_s + frame_s - start_s
        else:
            found.append((value, time_s, frame_s))
    return found


def _legend(axes: Any, colours: dict[str, str]) -> None:
    from matplotlib.patches import Patch

    axes.legend(
        handles=[Patch(color=colour, label=name) for name, colour in colours.items()],
        loc="upper left", bbox_to_anchor=(1, 1), fontsize=7,
    )  # fmt: skip


def _draw_counts(axes: Any, run: RecordedRun) -> str:
    if not run.times_s:
        return ""
    axes.step(run.times_s, run.shown, linewidth=0.8)
    axes.set_xlabel("s")
    axes.set_ylim(bottom=0, top=max(1, *run.shown) + 0.5)
    axes.yaxis.get_major_locator().set_params(integer=True)
    return "Confirmed and coasting targets in each frame."


def _draw_ages(axes: Any, run: RecordedRun) -> str:
    """Age of each record, and the frames and records lost so far."""
    is_aged = any(not math.isnan(age) for age in run.ages_ms)
    if not is_aged and not any(run.lost) and not any(run.missing):
        return ""
    if is_aged:
        axes.plot(run.times_s, run.ages_ms, linewidth=0.8)
        axes.set_ylabel("age, ms")
        axes.set_ylim(bottom=0)
    axes.set_xlabel("s")
    lost = axes.twinx() if is_aged else axes
    lost.step(run.times_s, run.missing, linewidth=0.8, color="#d62728")
    lost.step(run.times_s, run.lost, linewidth=0.8, color="#d62728", linestyle="dotted")
    lost.set_ylabel("lost so far")
    lost.set_ylim(bottom=0, top=max(1, *run.missing, *run.lost))
    lost.yaxis.get_major_locator().set_params(integer=True)
    age = "Time from capture to publishing (blue); so" if is_aged else "So"
    return (
        f"{age} far, frames of the source without a record, as where a queue drops (red), and records that "
        "the publisher could not deliver (dotted)."
    )


def _draw_registration(axes: Any, run: RecordedRun) -> str:
    """Status of each frame, and the predicted error."""
    if not any(run.statuses):
        return ""
    top = max([1.0, *(std for std in run.corner_std if not math.isnan(std))])
    for status, start_s, width_s in _stretches(run.times_s, run.statuses):
        if status:
            axes.axvspan(
                start_s, start_s + width_s, color=STATUS_COLOURS.get(status, "#888888"), alpha=0.4, lw=0
            )
    axes.plot(run.times_s, run.corner_std, linewidth=0.8, color="black")
    axes.set_ylim(0, top)
    axes.set_xlabel("s")
    axes.set_ylabel("corner_std, px")
    _legend(axes, STATUS_COLOURS)
    return "Status of each frame, and its predicted error at the corners, one standard deviation (black)."
