"""Metadata: what detections must hold."""

import re
from typing import Any

import numpy as np
import pytest

from streamkit import Detections

COLUMNS: dict[str, Any] = {
    "centroids": np.array([[30.0, 50.0]]),
    "boxes": np.array([[20.0, 40.0, 40.0, 60.0]]),
    "areas": np.array([400.0]),
    "scores": np.array([0.9]),
}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"boxes": np.zeros((2, 4))}, "of 1 detections must be an array of shape (1, 4), got shape (2, 4)"),
        ({"scores": np.zeros(0)}, "scores of 1 detections must be an array of shape (1,), got shape (0,)"),
        ({"centroids": [[30, 50]]}, "of 1 detections must be an array of shape (1, 2), got no array"),
        ({"labels": ("car", "bus")}, "labels of 1 detections must be 1 or none, got 2"),
        ({"scores": np.array([np.nan])}, "scores of detections must be finite, got [nan]"),
        ({"areas": np.array([np.inf])}, "areas of detections must be finite, got [inf]"),
        ({"boxes": np.array([[9.0, 8.0, 5.0, 9.0]])}, "x0 y0 x1 y1, not left top width height, got [9.0,"),
    ],
)  # fmt: skip
def test_columns_that_do_not_fit_are_refused(wrong: dict[str, Any], message: str) -> None:
    """Where they are made: the tracker would find no target in them, or fail in numpy."""
    with pytest.raises(ValueError, match=re.escape(message)):
        Detections(**{**COLUMNS, **wrong})


def test_columns_that_fit_are_taken() -> None:
    """Also none at all, a box of one point, and one of NaN, which the elements count as unusable."""
    assert len(Detections(**COLUMNS, labels=("car",))) == 1
    assert len(Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))) == 0
    for value in (0.0, np.nan):
        assert len(Detections(**{**COLUMNS, "boxes": np.full((1, 4), value)})) == 1
