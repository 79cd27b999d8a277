"""The readings on real images, with few repetitions: goals, shapes, and peers."""

from pathlib import Path

import pytest

from streamkit_wavelet_eigen.experiments.peers import (
    fisherfaces_rate,
    lbp_rate,
    pca_rate,
)
from streamkit_wavelet_eigen.experiments.recognition import (
    BEST,
    METHODS,
    MODULAR,
    PROPOSED,
    rates,
    reading_a,
    reading_b,
    reading_c,
)
from streamkit_wavelet_eigen.experiments.results import TABLE_1, TABLE_3
from streamkit_wavelet_eigen.experiments.splits import (
    DatabaseSplit,
    MissingData,
    data_folder,
    read_coil20,
    read_orl,
    splits,
)


@pytest.fixture(scope="module")
def orl(shared_folder: Path) -> list[DatabaseSplit]:
    """Two splits of ORL with 5 training images."""
    return list(splits(read_orl(data_folder(shared_folder)), 5, 2))


@pytest.fixture(scope="module")
def coil(shared_folder: Path) -> list[DatabaseSplit]:
    """Two splits of COIL-20 with 9 training images."""
    return list(splits(read_coil20(data_folder(shared_folder)), 9, 2))


def test_presets_recognise_faces(orl: list[DatabaseSplit]) -> None:
    """Near the figures of the whole experiment, which has ten splits, whichever preset."""
    best, modular, paper = (rates(METHODS[name], orl[:1])["mean"] for name in (BEST, MODULAR, PROPOSED))
    assert best >= 94.0
    assert modular >= 91.0
    assert paper >= 88.0


def test_the_best_preset_recognises_objects(coil: list[DatabaseSplit]) -> None:
    """Above the goal that is set for the mean of ten splits, less one deviation."""
    assert rates(METHODS[BEST], coil[:1])["mean"] >= 91.0


def test_reading_a_is_above_the_published_cells(orl: list[DatabaseSplit], coil: list[DatabaseSplit]) -> None:
    """With the paper chain, for each number of targets; with one target every answer is right."""
    columns = TABLE_1.columns["orl-5train"], TABLE_3.columns["coil20-9train"]
    for parts, cells in zip((orl, coil), columns, strict=True):
        figures = reading_a(METHODS[PROPOSED], parts)
        assert figures[0]["mean"] == 100.0
        assert all(ours["mean"] > cell for ours, cell in zip(figures, cells, strict=True))


def test_reading_b_is_a_share(orl: list[DatabaseSplit]) -> None:
    """Held-out faces are reconstructed by about four fifths, better with more training targets."""
    figures = [figure["mean"] for figure in reading_b(orl)]
    assert 70.0 < min(figures) < max(figures) < 95.0
    assert figures[-1] > figures[0]


def test_reading_c_rises_and_saturates(orl: list[DatabaseSplit]) -> None:
    """More features for each block help at first; from 5 on they change little."""
    figures = [figure["mean"] for figure in reading_c(orl)]
    assert figures[4] > figures[0]
    assert abs(figures[9] - figures[4]) <= 2.0
    assert figures[9] == pytest.approx(rates(METHODS[PROPOSED], orl)["mean"], abs=0.01)


def test_peers_are_near_their_known_rates(orl: list[DatabaseSplit]) -> None:
    """scikit-learn's PCA and Fisherfaces and scikit-image's LBP, as their literature has them on ORL."""
    assert pca_rate(orl[0]) == pytest.approx(93, abs=4)
    assert fisherfaces_rate(orl[0]) == pytest.approx(95, abs=4)
    assert lbp_rate(orl[0]) == pytest.approx(95, abs=5)


def test_missing_data_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder, a folder without databases, and an incomplete database: each error names the remedy."""
    monkeypatch.delenv("STREAMKIT_DATA", raising=False)
    with pytest.raises(MissingData, match="--data or set STREAMKIT_DATA"):
        data_folder()
    with pytest.raises(MissingData, match="there must be folders orl"):
        data_folder(tmp_path)
    (tmp_path / "orl").mkdir()
    (tmp_path / "coil20").mkdir()
    with pytest.raises(MissingData, match=r"orl/s1/1\.pgm: the database is not whole"):
        read_orl(data_folder(tmp_path))
    with pytest.raises(MissingData, match="20 objects with 24 views"):
        read_coil20(tmp_path)
