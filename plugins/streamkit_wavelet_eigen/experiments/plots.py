"""Figure 3: the proposed and the traditional method with error bars."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from streamkit_wavelet_eigen.experiments.methods import BEST, PROPOSED, TRADITIONAL
from streamkit_wavelet_eigen.experiments.published import FIGURE_3, PERCENTAGES, TARGETS

if TYPE_CHECKING:
    from streamkit_wavelet_eigen.experiments.results import PartitionResult, Results

SHOWN = ((PROPOSED, "#1f77b4", "o"), (TRADITIONAL, "#d62728", "s"), (BEST, "#2ca02c", "^"))
# The same bytes for the same results: no date, and fixed element ids.
STYLE: Any = {"svg.hashsalt": "streamkit", "svg.fonttype": "none", "font.size": 8}


def draw_figure_3(results: Results, path: Path) -> None:
    """Draws recognition by number of targets (reading A) for each partition, all on the same axes.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        for panel, (key, partition) in zip(panels.flat, results["partitions"].items(), strict=True):
            _draw_panel(panel, key, partition)
        panels.flat[0].legend(loc="lower left", fontsize=7)
        figure.supxlabel("targets in the gallery")
        figure.supylabel("recognition, %: mean and standard deviation of the random splits")
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": "streamkit experiments"})


def _draw_panel(panel: Any, key: str, partition: PartitionResult) -> None:
    for shift, (name, colour, marker) in zip((-0.12, 0.0, 0.12), SHOWN, strict=True):
        figures = partition["reading_a"][name]
        panel.errorbar(
            [count + shift for count in TARGETS],
            [one["mean"] for one in figures],
            [one["deviation"] for one in figures],
            color=colour, marker=marker, markersize=3, linewidth=1, capsize=2, label=name,
        )  # fmt: skip
    for table in PERCENTAGES:
        if key in table.columns:
            panel.plot(
                TARGETS, table.columns[key], color="#555555", linestyle=":", label="published, table cells"
            )
    for (name, value), style in zip(FIGURE_3.items(), ("--", "-."), strict=True):
        panel.axhline(
            value, color="#999999", linestyle=style, linewidth=0.8, label=f"published, {name}, figure 3"
        )
    panel.set_title(key)
    panel.set_ylim(60, 103)
    panel.set_xticks(TARGETS)
    panel.grid(alpha=0.3)
