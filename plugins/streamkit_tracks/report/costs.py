"""What each element cost in a run, from the counters that `launch --stats-file` writes."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any, Literal

import msgspec

from streamkit import StreamError

HEADS = ("frames", "ms a frame", "busy, %", "dropped", "element")


class ElementCost(msgspec.Struct, frozen=True):
    """Counters of an element; see `streamkit.graph.statistics`."""

    element: str
    frames_in: int
    frames_out: int
    busy_ns: int
    dropped: dict[str, int]
    queue: dict[str, Any] | None


class RunCosts(msgspec.Struct, frozen=True):
    """The counters of a run."""

    schema: Literal["streamkit.statistics/1"]
    elapsed_s: float
    elements: list[ElementCost]


def read_costs(path: Path) -> RunCosts:
    """The counters in a file.

    Raises:
        OSError: the file cannot be read.
        StreamError: it holds something else.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=RunCosts)
    except msgspec.DecodeError as error:
        raise StreamError(
            f"--stats {path}: {error}; give the file that streamkit launch --stats-file wrote"
        ) from None


def cost_table(run: RunCosts) -> str:
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
                str(sum(item.dropped.values())),
                escape(item.element),
            )
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in HEADS)
    return f"<h2>Cost of elements</h2><table><tr>{head}</tr>{''.join(rows)}</table>"
