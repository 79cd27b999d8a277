"""Fixtures of the evaluation's tests."""

from collections.abc import Callable

import numpy as np
import pytest

from streamkit_tracks.evaluation.scores import Labelled


@pytest.fixture(scope="session")
def frames() -> Callable[..., list[Labelled]]:
    """Makes frames of boxes of 10 x 10 px at the given left edges, a dict by id for each frame."""

    def make(*rows: dict[int, float]) -> list[Labelled]:
        boxes = [np.array([[left, 0.0, 10.0, 10.0] for left in row.values()]).reshape(-1, 4) for row in rows]
        return [Labelled(np.array(list(row), np.int64), each) for row, each in zip(rows, boxes, strict=True)]

    return make
