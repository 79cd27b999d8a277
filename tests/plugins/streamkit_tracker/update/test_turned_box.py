"""Shapes from boxes."""

import math

import numpy as np
import pytest

from streamkit_tracker.targets import TARGET
from streamkit_tracker.update.detected_box import turned_shapes, window_shapes


def window_shape(width: float, height: float, heading: float) -> list[float]:
    """Length and width of one window."""
    shape: list[float] = window_shapes(np.array([[width, height]]), np.array([heading]))[0].tolist()
    return shape


def turned_window(width: float, height: float, heading: float) -> list[float]:
    """Length, width and angle of the window of a target that moves fast."""
    targets = np.zeros(1, TARGET)
    targets["box"], targets["mean"][:, 2:] = (
        (width, height),
        (1e3 * math.cos(heading), 1e3 * math.sin(heading)),
    )
    found: list[float] = turned_shapes(targets)[0][0].tolist()
    return found


@pytest.mark.parametrize("heading", [0.0, 0.3, 0.7, math.pi / 4, 1.2, math.pi / 2, 2.6, -0.8])
def test_a_car_is_recovered_from_its_upright_box(heading: float):
    """A 26 by 13 rectangle comes back within a pixel, also at 45 degrees where the box alone cannot tell."""
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    length, width = window_shape(26 * cosine + 13 * sine, 26 * sine + 13 * cosine, heading)
    assert length == pytest.approx(26, abs=1.0)
    assert width == pytest.approx(13, abs=1.0)


def test_length_lies_along_the_motion_even_when_it_is_shorter():
    """A box twice as wide as high that moves down has its short side along the motion."""
    length, width = window_shape(40.0, 20.0, math.pi / 2)
    assert length < width


@pytest.mark.parametrize("box", [(1.0, 1.0), (1.0, 300.0), (0.5, 0.5)])
def test_degenerate_boxes_give_positive_sides(box: tuple[float, float]):
    """No box gives a side below two pixels."""
    assert min(window_shape(*box, 0.4)) >= 2.0


def test_an_upright_person_keeps_the_upright_box():
    """No rectangle along a slanting motion has the box of a person seen from the side."""
    assert turned_window(26.0, 92.0, 0.6) == [26.0, 92.0, 0.0]


@pytest.mark.parametrize("heading", [0.3, 1.2, -0.8])
def test_a_car_turns_with_its_motion(heading: float):
    """Where a turned rectangle fills the box, it is the window."""
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    _, _, angle = turned_window(26 * cosine + 13 * sine, 26 * sine + 13 * cosine, heading)
    assert angle == pytest.approx(heading)


def test_a_target_at_rest_keeps_the_angle_of_its_window():
    """What hardly moves may turn on the spot: its direction is not known."""
    targets = np.zeros(1, TARGET)
    targets["box"], targets["window"], targets["mean"] = (26, 13), (0, 0, 26, 13, 0.05), (0, 0, -1, 1)
    shapes, deviations = turned_shapes(targets)
    assert shapes[0, 2] == pytest.approx(0.05)
    assert np.isinf(deviations).all()
