"""Where a chain is cut so that the cores have like work."""

import pytest

from streamkit.graph.processes.balance import balanced_cuts


@pytest.mark.parametrize(
    ("work", "cuts", "cores", "crossing", "wanted"),
    [
        ([4, 4], [1], 2, 0.0, [1]),
        ([1, 1, 1, 3], [1, 2, 3], 2, 0.0, [3]),
        ([1, 1, 1, 3], [1, 2], 2, 0.0, [2]),  # not where it is not allowed
        ([2, 2, 2], [1, 2], 3, 0.0, [1, 2]),
        ([2, 2, 2], [1, 2], 2, 0.0, [1]),
        ([4, 4], [1], 1, 0.0, []),
        ([4, 4], [1], 2, 4.0, []),  # crossing costs what the cut saves
        ([10, 0.9], [1], 2, 0.0, []),  # saves less than a tenth
        ([10, 1.2], [1], 2, 0.0, [1]),
        ([5, 5, 0, 0], [1, 2, 3], 4, 0.0, [1]),  # no more processes than help
        ([0, 0], [1], 2, 0.0, []),
        ([3], [], 8, 0.0, []),
    ],
)
def test_cuts(work: list[float], cuts: list[int], cores: int, crossing: float, wanted: list[int]) -> None:
    """The busiest process has as little to do as possible, with as few processes as that needs."""
    assert balanced_cuts(work, cuts, cores, crossing) == wanted
