"""The flights of the benchmark, of which one once went on at a place on another plane."""

import importlib
from pathlib import Path

import cv2
import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_a_frame_whose_place_is_on_another_plane_does_not_go_on_there(
    streamkit_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cut between scenes alike is not noticed: features match an earlier plane, but not well enough."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    meeting = importlib.import_module("planes_that_meet")
    picture = cv2.imread(str(streamkit_data / "mosaic" / "aerial_cc0.jpg"), cv2.IMREAD_GRAYSCALE)
    ground = np.asarray(picture, dtype=np.uint8)
    shown, _ = meeting.flight(ground, 10)
    planes, errors = meeting.measure(shown)
    assert planes > 1
    assert len(errors) > 150
    assert (errors <= meeting.LIMIT_PX).all()
