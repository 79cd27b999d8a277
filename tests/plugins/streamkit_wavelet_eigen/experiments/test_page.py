"""The result page says what the results say, and the page in docs/ is made from the JSON next to it."""

import json
import re
from pathlib import Path
from typing import cast

import pytest

from streamkit_wavelet_eigen.experiments.page import draw_figure_3, page
from streamkit_wavelet_eigen.experiments.recognition import BEST, CANDIDATES, METHODS, MODULAR, PROPOSED
from streamkit_wavelet_eigen.experiments.results import ERRORS, PERCENTAGES, SCHEMA, Results

DOCS = Path(__file__).parents[4] / "docs"


@pytest.fixture(scope="module")
def results() -> Results:
    """What the last full run found."""
    return cast("Results", json.loads((DOCS / "paper-tables.json").read_text(encoding="utf-8")))


def test_the_page_is_made_from_the_results(results: Results) -> None:
    """Nobody writes into it by hand."""
    assert (DOCS / "paper-tables.md").read_text(encoding="utf-8") == page(results)


def test_the_figure_is_made_from_the_results(results: Results, tmp_path: Path) -> None:
    """The same results draw the same bytes, here and in docs/."""
    one, again = tmp_path / "one.svg", tmp_path / "again.svg"
    draw_figure_3(results, one)
    draw_figure_3(results, again)
    assert one.read_bytes() == again.read_bytes()
    kept = (DOCS / "paper-figure-3.svg").read_text(encoding="utf-8")
    for name in ("published, proposed, figure 3", "published, traditional, figure 3", "orl-5train", BEST):
        assert name in kept


def test_the_results_are_those_of_the_whole_experiment(results: Results) -> None:
    """Ten splits, a hundred sequences, every method, candidate and row."""
    assert (results["schema"], results["repetitions"], results["tracking_runs"]) == (SCHEMA, 10, 100)
    sizes = {
        key: (one["training_pictures"], one["test_pictures"]) for key, one in results["partitions"].items()
    }
    assert sizes == {
        "orl-5train": (200, 200), "orl-3train": (120, 280),
        "coil20-12train": (240, 240), "coil20-9train": (180, 300),
    }  # fmt: skip
    for one in results["partitions"].values():
        assert list(one["recognition"]) == list(METHODS)
        assert all(figure["n"] == 10 for figure in one["recognition"].values())
        assert len(one["peers"]) == 3
        assert set(one["selection"]["inner"]) == set(CANDIDATES)
        assert sum(one["selection"]["chosen"].values()) == 10
        assert len(one["reading_b"]) == len(one["reading_c"]) == 10
        assert [figure["n"] for figure in one["tracking"]] == list(range(10, 101, 10))


@pytest.mark.parametrize(
    ("method", "goals"), [(MODULAR, (93.5, 87.5, 89.0, 86.0)), (BEST, (96.0, 90.0, 95.0, 92.5))]
)
def test_goals_are_reached(results: Results, method: str, goals: tuple[float, ...]) -> None:
    """Raw modular PCA and the best preset reach what was set for them."""
    means = [one["recognition"][method]["mean"] for one in results["partitions"].values()]
    assert all(mean >= goal for mean, goal in zip(means, goals, strict=True)), means


def test_the_selection_without_test_images_holds_for_them_too(results: Results) -> None:
    """What each split chose for itself on training images is as good as the preset, within a point."""
    for one in results["partitions"].values():
        assert one["selection"]["outer"]["mean"] >= one["recognition"][BEST]["mean"] - 1.0


def test_every_published_percentage_is_exceeded(results: Results) -> None:
    """Under reading A with the paper chain, in all forty cells of tables 1 and 3."""
    text = page(results)
    assert text.count("Under reading A 10 of 10 cells lie above the published ones.") == 4


def test_published_cells_stand_on_the_page(results: Results) -> None:
    """Each cell of the four tables is there, in the row of its target or run count."""
    rows = [
        re.split(r"\s*\|\s*", line.strip("| ")) for line in page(results).splitlines() if line.startswith("|")
    ]
    for table in (*PERCENTAGES, *ERRORS):
        for index, count in enumerate(table.rows):
            for cells in table.columns.values():
                text = f"{cells[index]:.2f}" if table in PERCENTAGES else f"{cells[index]:.1f}"
                assert any(row[0] == str(count) and text in row for row in rows), (table.number, count, text)
    assert "| 1 | 78.08 | 81.87 |" in page(results)


@pytest.mark.parametrize(
    ("preset", "method"), [("paper", PROPOSED), ("modular", MODULAR), ("recognition", BEST)]
)
def test_the_presets_page_has_the_same_figures(results: Results, preset: str, method: str) -> None:
    """docs/wavelet-eigen.md repeats the rates of the presets, rounded to a tenth."""
    text = (DOCS / "wavelet-eigen.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| `{preset}` \|.*", text, re.MULTILINE)
    figures = [f"{one['recognition'][method]['mean']:.1f}" for one in results["partitions"].values()]
    assert row.split("|")[3:7] == [f" {figure} " for figure in figures]
