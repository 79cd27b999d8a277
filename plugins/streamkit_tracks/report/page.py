"""The page of a report: one HTML file that loads nothing."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

from streamkit import SECOND_NS

if TYPE_CHECKING:
    from streamkit import RunStatistics
    from streamkit_tracks.report.run_data import RecordedRun, TargetPath

MAX_TARGETS = 200
HEADS = ("frames", "ms a frame", "busy, %", "dropped", "element")
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
img { max-width: 100%; background: white; } figure { margin: 1.5rem 0; overflow-x: auto; }
figcaption { color: #555; } img[src^="data:image/svg"] { min-width: 38rem; } td img { min-width: 4rem; }
table { border-collapse: collapse; } td, th { padding: .2rem .4rem; text-align: right; }
td:last-child, th:last-child { text-align: left; } tr { border-bottom: 1px solid #ccc8; }
"""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def build_page(
    run: RecordedRun,
    title: str,
    figures: Mapping[str, tuple[str, bytes]],
    frame: bytes,
    crops: Mapping[int, bytes],
    costs: str = "",
) -> str:
    """The page.

    Args:
        run: what it is about.
        title: of the page.
        figures: caption and SVG by heading.
        frame: JPEG of the frame with the most targets; empty without a video.
        crops: JPEG of each target, by id.
        costs: what elements cost, HTML.
    """
    head = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
    )
    parts = [head, f"<body><h1>{escape(title)}</h1><p>{escape(_totals(run))}</p>"]
    if frame:
        caption = "The frame with the most targets."
        parts.append(_figure(_image(frame, "image/jpeg", caption), caption))
    for heading, (caption, svg) in figures.items():
        image = _image(svg, "image/svg+xml", f"{heading}: {caption}")
        parts.append(f"<h2>{escape(heading)}</h2>{_figure(image, caption)}")
    parts += [costs, _table(run.shown_paths(), crops)]
    return "\n".join([*parts, "</body></html>\n"])


def _totals(run: RecordedRun) -> str:
    paths, frames = run.shown_paths(), len(run.times_s)
    seconds = run.times_s[-1] if run.times_s else 0.0
    first = next((pts for pts in run.pts_ns if pts is not None), None)
    start = f", from {first / SECOND_NS:.2f} s of the stream on, where times here begin" if first else ""
    missing = f" ({run.missing[-1]} more have no record)" if any(run.missing) else ""
    size = "" if run.size is None else f" of {run.size[0]} x {run.size[1]} px"
    states = Counter(filter(None, run.statuses))
    registration = ", ".join(f"{count} {status}" for status, count in states.most_common())
    states_text = f"; registration: {registration}" if registration else ""
    return (
        f"Source {run.source}: {frames} frames{missing}{size} in {seconds:.1f} s{start}, "
        f"{len(paths)} confirmed targets of {len(run.paths)} ids{states_text}."
    )


def _image(data: bytes, media_type: str, text: str) -> str:
    content = base64.b64encode(data).decode()
    return f'<img alt="{escape(text)}" src="data:{media_type};base64,{content}">'


def _figure(image: str, caption: str) -> str:
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"


def _table(paths: list[TargetPath], crops: Mapping[int, bytes]) -> str:
    """The targets, the longest first."""
    rows = []
    for path in paths[:MAX_TARGETS]:
        states = ", ".join(f"{count} {state}" for state, count in Counter(path.states).items())
        crop = _image(crops[path.id], "image/jpeg", f"target {path.id}") if path.id in crops else ""
        rows.append(
            f"<tr><td>{crop}</td><td>{path.id}</td><td>{path.times_s[0]:.2f}</td>"
            f"<td>{path.times_s[-1]:.2f}</td><td>{len(path.times_s)}</td><td>{escape(states)}</td></tr>"
        )
    left_out = len(paths) - len(rows)
    note = f"<p>{left_out} more, of fewer frames, are not listed.</p>" if left_out else ""
    head = "".join(f"<th>{name}</th>" for name in ("", "id", "from, s", "to, s", "frames", "states"))
    return f"<h2>Targets</h2><table><tr>{head}</tr>{''.join(rows)}</table>{note}"


def cost_table(run: RunStatistics) -> str:
    """The elements as HTML, the costliest first; queues, whose time is that of waiting, are left out."""
    rows = []
    for item in sorted(run.elements, key=lambda item: -item.busy_ns):
        if item.queue is None:
            frames = max(item.frames_in, item.frames_out)
            share = item.busy_ns / 1e7 / run.elapsed_s if run.elapsed_s else 0.0
            cells = (
                str(frames),
                f"{item.busy_ns / 1e6 / max(1, frames):.2f}",
                f"{share:.1f}",
                str(item.total_dropped),
                escape(item.element),
            )
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in HEADS)
    return f"<h2>Cost of elements</h2><table><tr>{head}</tr>{''.join(rows)}</table>"
