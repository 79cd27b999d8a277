"""Optimal assignment of rows to columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import FloatArray

CountArray = NDArray[np.int64]

FORBIDDEN = 1e6


def assign(costs: FloatArray, allowed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs rows and columns at the least total cost; pairs that are not allowed stay apart.

    Args:
        costs: float64[t, d], finite where allowed.
        allowed: bool[t, d].

    Returns:
        Pairs (row, column), in order of the rows.

    Source: Crouse, On implementing 2D rectangular assignment algorithms, IEEE Transactions on Aerospace and
    Electronic Systems 52, 2016. scipy's is the same, but takes most of a second to import.
    """
    if costs.size == 0 or not allowed.any():
        return []
    # finite costs only: the search ends because some column is always nearest
    finite = np.where(allowed, np.fmin(costs, FORBIDDEN), FORBIDDEN)
    wide = len(costs) <= costs.shape[1]
    partners = np.full(min(costs.shape), -1, np.int64)
    _match(np.ascontiguousarray(finite if wide else finite.T), partners)
    chosen = enumerate(partners.tolist())
    pairs = list(chosen) if wide else sorted((row, column) for column, row in chosen)
    return [pair for pair in pairs if allowed[pair]]


@compiled
def _shortest_path(
    costs: FloatArray,
    start: int,
    row_prices: FloatArray,
    column_prices: FloatArray,
    holders: CountArray,
    before: CountArray,
    shortest: FloatArray,
    settled: NDArray[np.bool_],
) -> tuple[int, float]:
    """Shortest augmenting path from a row to a free column, and its length: Dijkstra's algorithm.

    `before`, int64[m], `shortest`, float64[m], and `settled`, bool[m], are filled: the row through which each
    column is reached, how far it is, and whether that is final.
    """
    shortest[:], settled[:] = np.inf, False
    row, length = start, 0.0
    while True:
        nearest, least = -1, np.inf
        line, further = costs[row], length - row_prices[row]
        for column in range(len(holders)):
            if settled[column]:
                continue
            way = further + line[column] - column_prices[column]
            if way < shortest[column]:
                shortest[column], before[column] = way, row
            if shortest[column] < least:
                nearest, least = column, shortest[column]
        length, settled[nearest] = least, True
        if holders[nearest] < 0:
            return nearest, length
        row = holders[nearest]


@compiled
def _match(costs: FloatArray, partners: CountArray) -> None:
    """Finds every row's column, int64[n], at the least total of costs float64[n, m], n not above m."""
    rows, columns = costs.shape
    row_prices, column_prices = np.zeros(rows), np.zeros(columns)
    holders, before = np.full(columns, -1, np.int64), np.empty(columns, np.int64)
    shortest, settled = np.empty(columns), np.empty(columns, np.bool_)
    for start in range(rows):
        end, length = _shortest_path(
            costs, start, row_prices, column_prices, holders, before, shortest, settled
        )
        row_prices[start] += length
        for column in range(columns):
            if settled[column]:
                column_prices[column] -= length - shortest[column]
                if column != end:
                    row_prices[holders[column]] += length - shortest[column]
        # augment along the shortest path
        row, column = -1, end
        while row != start:
            row = before[column]
            holders[column] = row
            partners[row], column = column, partners[row]
