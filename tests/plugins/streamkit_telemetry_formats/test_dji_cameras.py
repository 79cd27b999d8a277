"""Fields of view of DJI's cameras."""

import math

import pytest

from streamkit_telemetry_formats.dji import camera_view, focal_view


@pytest.mark.parametrize("model", ["DJI Mini 2", "mini-2", "MINI2", "FC7303", "fc7303 "])
def test_a_model_is_known_by_any_spelling_and_by_its_camera(model: str) -> None:
    """Its 83 degrees along the diagonal of 4:3 are 70.6 across."""
    view = camera_view(model)
    assert view is not None
    assert math.degrees(view) == pytest.approx(70.58, abs=0.01)


@pytest.mark.parametrize("model", ["", "DJI", "mini", "FC", "Canon PowerShot SX260 HS"])
def test_other_models_are_unknown(model: str) -> None:
    """Nothing is guessed."""
    assert camera_view(model) is None


def test_a_frame_of_another_shape_is_cut_out_of_the_sensor() -> None:
    """One wider than the sensor has its width, a narrower one its height: 8.8 mm behind 13.2 x 8.8 mm."""
    wide, whole, narrow = (camera_view("Phantom 4 Pro", aspect) for aspect in (16 / 9, 3 / 2, 4 / 3))
    assert wide == whole == pytest.approx(2 * math.atan(6.6 / 8.8), abs=0.01)
    assert narrow == pytest.approx(2 * math.atan(6.6 * 8 / 9 / 8.8), abs=0.01)


@pytest.mark.parametrize(("model", "focal_mm"), [("mavic-3", 24), ("phantom-4", 20), ("mavic-pro", 26)])
def test_focal_lengths_agree_with_the_fields_of_view(model: str, focal_mm: float) -> None:
    """DJI publishes both, the focal length in whole millimetres."""
    assert camera_view(model) == pytest.approx(focal_view(focal_mm), rel=0.02)
