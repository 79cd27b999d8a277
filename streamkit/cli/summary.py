"""What a run has made, in its last line: frames, tracks, drops, files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import msgspec

from streamkit.output.pipe import STANDARD_OUTPUT

if TYPE_CHECKING:
    from streamkit.flow.statistics import RunStatistics

LABELS = {"tracks": "confirmed tracks", "deleted_files": "deleted files"}


class RunSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A run in short: the JSON of `launch --summary=json`.

    Attributes:
        schema: name and version of the format.
        elapsed_s: since the run began, s.
        frames: that arrived at a sink, most of any; of video if there is some, else of anything.
        dropped: frames not delivered, over all elements.
        reasons: how many of those, by reason.
        results: what elements have made, by name; `tracks` are those that were confirmed.
        files: number of the files written, by location, which is a pattern where there are several.
        incomplete: locations whose last file lacks frames that arrived, because its sink has failed.
    """

    schema: Literal["streamkit.summary/1"] = "streamkit.summary/1"
    elapsed_s: float
    frames: int
    dropped: int
    reasons: dict[str, int] = {}
    results: dict[str, int]
    files: dict[str, int]
    incomplete: list[str] = []


def summarise(statistics: RunStatistics) -> RunSummary:
    """The summary of counters."""
    results: Counter[str] = Counter()
    for row in statistics.elements:
        results.update({name: count for name, count in row.results.items() if name != "files"})
    reasons: Counter[str] = Counter()
    for row in statistics.elements:
        reasons.update(row.dropped)
    sinks = [row for row in statistics.elements if all(pad.direction == "sink" for pad in row.pads)]
    pads = [pad for row in sinks for pad in row.pads]
    video = [pad.frames for pad in pads if (pad.caps or "").startswith("video/")]
    return RunSummary(
        elapsed_s=statistics.elapsed_s,
        frames=max(video, default=0) or max((pad.frames for pad in pads), default=0),
        dropped=reasons.total(),
        reasons=dict(reasons),
        results=dict(results),
        files={row.location: count for row in statistics.elements if (count := row.results.get("files"))},
        incomplete=[row.location for row in statistics.elements if row.location and row.has_failed],
    )


def dropped_text(dropped: Mapping[str, int]) -> str:
    """Total and reasons: "7 (queue full: 5; late: 2)", of one reason "7 (queue full)"; "" for none."""
    if not dropped:
        return ""
    counted = (f"{reason}: {count}" for reason, count in sorted(dropped.items()))
    return f"{sum(dropped.values())} ({'; '.join(counted if len(dropped) > 1 else dropped)})"


def written_files(statistics: RunStatistics) -> dict[str, list[str]]:
    """The first and the last file written, by location."""
    return {row.location: row.written for row in statistics.elements if row.written}


def as_text(summary: RunSummary, written: Mapping[str, Sequence[str]] | None = None) -> str:
    """The last line of a run: "30 frames in 1.0 s, 30.0/s, 3 confirmed tracks, wrote tracks.jsonl".

    Args:
        summary: the run.
        written: first and last file by location, in place of patterns.
    """
    words = [f"{summary.frames} frame{'s' * (summary.frames != 1)} in {summary.elapsed_s:.1f} s"]
    if summary.elapsed_s:
        words.append(f"{summary.frames / summary.elapsed_s:.1f}/s")
    if summary.dropped:
        words.append(f"dropped {dropped_text(summary.reasons)}")
    for name, count in summary.results.items():
        label = LABELS.get(name, name)
        words.append(f"{count} {label.removesuffix('s') if count == 1 else label}")
    files = [
        _files_text(count, " to ".join((written or {}).get(name, [name])), is_part=name in summary.incomplete)
        for name, count in summary.files.items()
    ]
    if files:
        words.append(f"wrote {' and '.join(files)}")
    return ", ".join(words)


def _files_text(count: int, names: str, *, is_part: bool) -> str:
    if names == STANDARD_OUTPUT:
        return "to the standard output"
    if count == 1:
        return f"part of {names}" if is_part else names
    return f"{count} files {names}" + (" (the last in part)" if is_part else "")
