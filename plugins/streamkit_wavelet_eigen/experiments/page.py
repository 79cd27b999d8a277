"""The results page in Markdown, our figures next to the published ones, and figure 3."""

import math
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from streamkit_wavelet_eigen.experiments.recognition import BEST, MODULAR, PROPOSED, TRADITIONAL
from streamkit_wavelet_eigen.experiments.results import (
    ERRORS,
    FIGURE_3,
    PERCENTAGES,
    TARGETS,
    Figure,
    PartitionResult,
    PublishedTable,
    Results,
)

# Required rates, percent, set before the experiment: raw modular PCA and the best preset.
GOALS = {
    MODULAR: {"orl-5train": 93.5, "orl-3train": 87.5, "coil20-12train": 89.0, "coil20-9train": 86.0},
    BEST: {"orl-5train": 96.0, "orl-3train": 90.0, "coil20-12train": 95.0, "coil20-9train": 92.5},
}
# Methods in figure 3, with their colours and markers.
SHOWN = ((PROPOSED, "#1f77b4", "o"), (TRADITIONAL, "#d62728", "s"), (BEST, "#2ca02c", "^"))
# The same bytes for the same results: no date, and fixed element ids.
STYLE: Any = {"svg.hashsalt": "streamkit", "svg.fonttype": "none", "font.size": 8}
READINGS = ["published", "A, paper chain", "A, traditional", "A, preset recognition", "B, reconstruction"]


def page(results: Results) -> str:
    """The whole page."""
    partitions = results["partitions"]
    sections = {
        "recognition": _recognition(partitions),
        "selection": _selection(partitions),
        "percentages": (line for table in PERCENTAGES for line in _percentages(table, results)),
        "reading_c": _reading_c(partitions),
        "figure_3": _figure_3(partitions),
        "errors": (line for table in ERRORS for line in _errors(table, partitions)),
        "averages": _averages(),
    }
    text = files(__package__).joinpath("page.md").read_text(encoding="utf-8")
    return text.format(
        repetitions=results["repetitions"],
        runs=results["tracking_runs"],
        **{name: "\n".join(lines) for name, lines in sections.items()},
    )


def _recognition(partitions: dict[str, PartitionResult]) -> Iterator[str]:
    yield "Percent, mean ± standard deviation of the splits.\n"
    yield from _head("method", partitions)
    first = next(iter(partitions.values()))
    for name in first["recognition"]:
        yield _row(name, [_shown(one["recognition"][name]) for one in partitions.values()])
    for name in first["peers"]:
        yield _row(f"peer: {name}", [_shown(one["peers"][name]) for one in partitions.values()])
    yield "\nGoals that were set beforehand:\n"
    yield from _head("method", partitions)
    for name, goals in GOALS.items():
        cells = []
        for key, one in partitions.items():
            reached = one["recognition"][name]["mean"] >= goals[key]
            cells.append(f"{goals[key]:.1f}: {'reached' if reached else '**missed**'}")
        yield _row(name, cells)
    yield ""


def _selection(partitions: dict[str, PartitionResult]) -> Iterator[str]:
    yield from _head("candidate: mean on inner splits (times chosen)", partitions)
    selections = [one["selection"] for one in partitions.values()]
    for name in selections[0]["inner"]:
        yield _row(
            name, [f"{one['inner'][name]['mean']:.1f} ({one['chosen'].get(name, 0)})" for one in selections]
        )
    yield _row("**chosen by each split, on its test images**", [_shown(one["outer"]) for one in selections])
    yield ""


def _percentages(table: PublishedTable, results: Results) -> Iterator[str]:
    yield f"### Table {table.number}\n"
    for key, printed in table.columns.items():
        one = results["partitions"][key]
        yield f"{key}, n = {results['repetitions']} splits, percent:\n"
        yield from _head("targets", READINGS)
        columns = [one["reading_a"][name] for name in (PROPOSED, TRADITIONAL, BEST)] + [one["reading_b"]]
        for index, targets in enumerate(table.rows):
            cells = [f"{printed[index]:.2f}"] + [_shown(column[index]) for column in columns]
            yield _row(str(targets), cells)
        means = [table.column_average(key)] + [_mean(column) for column in columns]
        yield _row("average", [f"{value:.2f}" for value in means])
        above = sum(ours["mean"] > cell for ours, cell in zip(columns[0], printed, strict=True))
        yield f"\nUnder reading A {above} of {len(printed)} cells lie above the published ones.\n"


def _reading_c(partitions: dict[str, PartitionResult]) -> Iterator[str]:
    yield "### Reading C: recognition by features for each block\n"
    yield "All targets, paper chain, percent.\n"
    yield from _head("features", partitions)
    for index in range(len(next(iter(partitions.values()))["reading_c"])):
        yield _row(str(index + 1), [_shown(one["reading_c"][index]) for one in partitions.values()])
    yield ""


def _figure_3(partitions: dict[str, PartitionResult]) -> Iterator[str]:
    yield "Mean over 1 to 10 targets, percent:\n"
    yield from _head("method", partitions)
    means = {}
    for name in (PROPOSED, TRADITIONAL):
        means[name] = [_mean(one["reading_a"][name]) for one in partitions.values()]
        yield _row(name, [f"{value:.2f}" for value in means[name]])
    differences = [one - other for one, other in zip(means[PROPOSED], means[TRADITIONAL], strict=True)]
    yield _row("proposed above traditional", [f"{value:+.2f}" for value in differences])
    yield ""


def _errors(table: PublishedTable, partitions: dict[str, PartitionResult]) -> Iterator[str]:
    yield f"### Table {table.number}\n"
    yield from _head(
        "n runs", [name for key in table.columns for name in (f"{key}, published", f"{key}, ours")]
    )
    pairs = [(printed, partitions[key]["tracking"]) for key, printed in table.columns.items()]
    for index, runs in enumerate(table.rows[: len(pairs[0][1])]):
        yield _row(
            str(runs),
            [text for printed, ours in pairs for text in (f"{printed[index]:.1f}", _shown(ours[index]))],
        )
    averages = [(table.column_average(key), _mean(partitions[key]["tracking"])) for key in table.columns]
    yield _row("average", [f"{value:.2f}" for pair in averages for value in pair])
    yield ""


def _averages() -> Iterator[str]:
    yield "## The published averages, recomputed from their cells\n"
    yield from _head("table", ["printed", "mean of its cells", "columns"])
    for table in sorted((*PERCENTAGES, *ERRORS), key=lambda one: one.number):
        columns = ", ".join(f"{key} {table.column_average(key):.2f}" for key in table.columns)
        yield _row(str(table.number), [f"{table.average:.2f}", f"{table.recomputed_average:.2f}", columns])
    yield ""


def _head(first: str, names: Iterable[str]) -> list[str]:
    names = list(names)
    return [_row(first, names), "|---|" + "---|" * len(names)]


def _row(first: str, cells: Sequence[str]) -> str:
    return f"| {first} | " + " | ".join(cells) + " |"


def _shown(figure: Figure) -> str:
    return f"{figure['mean']:.2f} ± {figure['deviation']:.2f}"


def _mean(figures: Sequence[Figure]) -> float:
    # The exact sum: that of `sum` depends on the version of Python from 3.12 on, and with it the last digit.
    return math.fsum(figure["mean"] for figure in figures) / max(len(figures), 1)


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
