"""The result page: our figures beside the published ones, in Markdown."""

from collections.abc import Iterable, Sequence

from streamkit_wavelet_eigen.experiments.figures_of_merit import Figure
from streamkit_wavelet_eigen.experiments.methods import BEST, MODULAR, PROPOSED, TRADITIONAL
from streamkit_wavelet_eigen.experiments.page_text import (
    BEGINNING,
    CHOICE,
    ERRORS_READING,
    FIGURE,
    LIMITS,
    PERCENTAGE_READINGS,
)
from streamkit_wavelet_eigen.experiments.published import ERRORS, PERCENTAGES, PublishedTable
from streamkit_wavelet_eigen.experiments.results import Results

# What has to be reached, percent: the lines for raw modular PCA and for the best preset.
GOALS = {
    MODULAR: {"orl-5train": 93.5, "orl-3train": 87.5, "coil20-12train": 89.0, "coil20-9train": 86.0},
    BEST: {"orl-5train": 96.0, "orl-3train": 90.0, "coil20-12train": 95.0, "coil20-9train": 92.5},
}


def page(results: Results) -> str:
    """The whole page."""
    parts = [
        BEGINNING.format(repetitions=results["repetitions"], runs=results["tracking_runs"]),
        "## Recognition over all targets\n",
        *_recognition(results),
        CHOICE,
        *_selection(results),
        PERCENTAGE_READINGS,
        *(line for table in PERCENTAGES for line in _percentages(table, results)),
        *_reading_c(results),
        FIGURE,
        *_figure_3(results),
        ERRORS_READING,
        *(line for table in ERRORS for line in _errors(table, results)),
        *_averages(),
        LIMITS,
    ]
    return "\n".join(parts).rstrip() + "\n"


def _recognition(results: Results) -> Iterable[str]:
    partitions = results["partitions"]
    yield "Percent, mean ± standard deviation of the splits.\n"
    yield from _head("method", partitions)
    first = next(iter(partitions.values()))
    for name in first["recognition"]:
        yield _row(name, [_shown(one["recognition"][name]) for one in partitions.values()])
    for name in first["peers"]:
        yield _row(f"peer: {name}", [_shown(one["peers"][name]) for one in partitions.values()])
    yield ""
    yield "Goals that were set beforehand:\n"
    yield from _head("method", partitions)
    for name, goals in GOALS.items():
        cells = []
        for key, one in partitions.items():
            reached = one["recognition"][name]["mean"] >= goals[key]
            cells.append(f"{goals[key]:.1f}: {'reached' if reached else '**missed**'}")
        yield _row(name, cells)
    yield ""


def _selection(results: Results) -> Iterable[str]:
    partitions = results["partitions"]
    yield from _head("candidate: mean on inner splits (times chosen)", partitions)
    for name in next(iter(partitions.values()))["selection"]["inner"]:
        cells = []
        for one in partitions.values():
            inner, chosen = one["selection"]["inner"][name], one["selection"]["chosen"].get(name, 0)
            cells.append(f"{inner['mean']:.1f} ({chosen})")
        yield _row(name, cells)
    yield _row("**chosen by each split, on its test pictures**",
               [_shown(one["selection"]["outer"]) for one in partitions.values()])  # fmt: skip
    yield ""


def _percentages(table: PublishedTable, results: Results) -> Iterable[str]:
    yield f"### Table {table.number}\n"
    for key, printed in table.columns.items():
        one = results["partitions"][key]
        yield f"{key}, n = {results['repetitions']} splits, percent:\n"
        yield from _head(
            "targets",
            ["published", "A, paper chain", "A, traditional", "A, preset recognition", "B, reconstruction"],
        )
        columns = [one["reading_a"][name] for name in (PROPOSED, TRADITIONAL, BEST)] + [one["reading_b"]]
        for index, targets in enumerate(table.rows):
            cells = [f"{printed[index]:.2f}"] + [_shown(column[index]) for column in columns]
            yield _row(str(targets), cells)
        means = [table.column_average(key)] + [_mean(column) for column in columns]
        yield _row("average", [f"{value:.2f}" for value in means])
        above = sum(ours["mean"] > cell for ours, cell in zip(columns[0], printed, strict=True))
        yield f"\nUnder reading A {above} of {len(printed)} cells lie above the published ones.\n"


def _reading_c(results: Results) -> Iterable[str]:
    partitions = results["partitions"]
    yield "### Reading C: recognition by features for each block\n"
    yield "All targets, paper chain, percent.\n"
    yield from _head("features", partitions)
    for index in range(len(next(iter(partitions.values()))["reading_c"])):
        yield _row(str(index + 1), [_shown(one["reading_c"][index]) for one in partitions.values()])
    yield ""


def _figure_3(results: Results) -> Iterable[str]:
    partitions = results["partitions"]
    yield "Mean over 1 to 10 targets, percent:\n"
    yield from _head("method", partitions)
    means = {}
    for name in (PROPOSED, TRADITIONAL):
        means[name] = [_mean(one["reading_a"][name]) for one in partitions.values()]
        yield _row(name, [f"{value:.2f}" for value in means[name]])
    apart = [one - other for one, other in zip(means[PROPOSED], means[TRADITIONAL], strict=True)]
    yield _row("proposed above traditional", [f"{value:+.2f}" for value in apart])
    yield ""


def _errors(table: PublishedTable, results: Results) -> Iterable[str]:
    yield f"### Table {table.number}\n"
    keys = list(table.columns)
    yield from _head("n runs", [name for key in keys for name in (f"{key}, published", f"{key}, ours")])
    columns = [results["partitions"][key]["tracking"] for key in keys]
    for index, runs in enumerate(table.rows):
        if index >= len(columns[0]):
            break
        cells = [
            text
            for key, column in zip(keys, columns, strict=True)
            for text in (f"{table.columns[key][index]:.1f}", _shown(column[index]))
        ]
        yield _row(str(runs), cells)
    averages = [
        f"{value:.2f}"
        for key, column in zip(keys, columns, strict=True)
        for value in (table.column_average(key), _mean(column))
    ]
    yield _row("average", averages)
    yield ""


def _averages() -> Iterable[str]:
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
    return sum(figure["mean"] for figure in figures) / max(len(figures), 1)
