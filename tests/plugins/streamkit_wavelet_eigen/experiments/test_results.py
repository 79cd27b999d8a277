"""The printed tables and what follows from their cells."""

import pytest

from streamkit_wavelet_eigen.experiments.results import ERRORS, PERCENTAGES, TABLE_1, PublishedTable


def test_table_1_is_printed_with_a_wrong_average() -> None:
    """The mean of its cells is 81.87, not 78.08."""
    assert (TABLE_1.average, TABLE_1.recomputed_average) == (78.08, 81.87)
    assert TABLE_1.column_average("orl-5train") == pytest.approx(85.15, abs=0.01)
    assert TABLE_1.column_average("orl-3train") == pytest.approx(78.58, abs=0.01)


@pytest.mark.parametrize("table", [table for table in (*PERCENTAGES, *ERRORS) if table is not TABLE_1])
def test_the_other_averages_agree_with_their_cells(table: PublishedTable) -> None:
    """Tables 2, 3 and 4 print the mean of their cells, rounded."""
    assert table.recomputed_average == pytest.approx(table.average, abs=0.011)


@pytest.mark.parametrize("table", [*PERCENTAGES, *ERRORS])
def test_every_row_has_a_cell_in_both_columns(table: PublishedTable) -> None:
    """Ten rows, two partitions."""
    assert len(table.rows) == 10
    assert [len(cells) for cells in table.columns.values()] == [10, 10]
