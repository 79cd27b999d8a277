"""Matching of targets over common frames."""

import pytest

from streamkit_fleet.batch.seam import match_ids

Box = tuple[float, float, float, float]


def box(x: float, y: float = 0.0) -> Box:
    """A square of 10 px."""
    return x, y, x + 10, y + 10


def test_targets_are_matched_by_most_of_their_frames() -> None:
    """One that passes another for a moment keeps its own id; a new one gets none."""
    frames = [({1: box(0), 2: box(4.0 * n)}, {7: box(0.5), 8: box(4.0 * n), 9: box(90)}) for n in range(8)]
    assert match_ids(frames) == {7: 1, 8: 2}


@pytest.mark.parametrize("frames", [[], [({}, {1: box(0)})], [({1: box(0)}, {2: box(20)})]])
def test_without_overlap_nothing_is_matched(frames: list[tuple[dict[int, Box], dict[int, Box]]]) -> None:
    """No frames, no targets, or targets elsewhere."""
    assert match_ids(frames) == {}
