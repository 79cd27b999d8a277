"""Tests of the cars' images."""

import numpy as np
import pytest

from streamkit_video.dronetestsrc.sprites import COLOURS, paint_car


def placed(x: float, y: float, heading: float = 0.0) -> np.ndarray:
    """A pose in the frame."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])


def moments(weights: np.ndarray) -> tuple[float, float, float]:
    """Mass and centre."""
    rows, columns = np.mgrid[: weights.shape[0], : weights.shape[1]]
    total = float(weights.sum())
    return total, float((weights * columns).sum() / total), float((weights * rows).sum() / total)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.1])
@pytest.mark.parametrize("scale", [0.5, 1.0, 1.4])
def test_a_body_lies_where_it_is_put(heading: float, scale: float) -> None:
    """The body covers length times width, and its middle is the pose's, to a tenth of a pixel."""
    sprite = paint_car(26.0, 12.0, (255, 255, 255), scale, 1)
    image = np.zeros((80, 90), np.uint8)
    flat = np.concatenate([sprite.body[:, :, -1:] * 255.0, sprite.body[:, :, -1:]], axis=2)
    sprite.draw(flat, image, placed(41.3, 38.6, heading))
    mass, x, y = moments(image / 255.0)
    # The rounded corners and the rounding of the hull take a few per cent.
    assert mass == pytest.approx(26.0 * 12.0 * scale**2, rel=0.07)
    assert (x, y) == pytest.approx((41.3, 38.6), abs=0.1 * max(1.0, scale))


def test_a_body_has_paint_glass_and_soft_edges() -> None:
    """A white car has dark windows, and no pixel at its border is all car or all ground."""
    image = np.full((40, 60, 3), 110, np.uint8)
    car = paint_car(28.0, 12.0, COLOURS[0], 1.0, 3)
    car.draw(car.body, image, placed(30.0, 20.0))
    middle = image[20, 16:45, 1].astype(int)
    assert middle.max() > 225
    assert middle.min() < 80
    side = image[10:20, 30, 1].astype(int)
    assert ((side > 120) & (side < 200)).any()


def test_a_shadow_darkens_only() -> None:
    """Shadows darken and leave the rest of the image unchanged."""
    image = np.full((40, 60), 110, np.uint8)
    car = paint_car(28.0, 12.0, COLOURS[0], 1.0, 1)
    car.draw(car.shadow, image, placed(30.0, 20.0))
    assert image.max() == 110
    assert 45 <= image[20, 30] <= 65
    assert (image[:6] == 110).all()


@pytest.mark.parametrize("place", [(-300.0, 10.0), (0.0, 0.0), (59.0, 39.0), (1e5, -1e5)])
def test_cars_are_cut_at_the_border(place: tuple[float, float]) -> None:
    """A car partly or wholly out of the frame is drawn as far as it is in it."""
    image = np.full((40, 60), 110, np.uint8)
    car = paint_car(28.0, 12.0, COLOURS[1], 1.0, 1)
    car.draw(car.body, image, placed(*place))
    changed = (image != 110).any()
    assert changed == (abs(place[0]) < 100)
