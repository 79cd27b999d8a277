"""Windows are centred to a fraction of a pixel, and flagged where they cannot be trusted."""

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.windows import Windows, cut_windows, rotated_boxes


def _cut(
    image: np.ndarray, box: tuple[float, float, float, float], patch: int = 16, margin: float = 1.0
) -> Windows:
    x0, y0, x1, y1 = box
    centre = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
    return cut_windows(image, rotated_boxes(centre, np.array([box])), patch, margin)


def _ramp(height: int = 60, width: int = 80) -> np.ndarray:
    return (np.arange(width)[None] * 2 + np.arange(height)[:, None]).astype(np.uint8)


def test_window_at_its_own_scale_is_the_crop() -> None:
    """A 16 px box around pixel centres gives exactly those pixels."""
    image = np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8)
    # The square spans 16 pixels: with an even side its middle lies between two of them.
    result = _cut(image, (19.5, 9.5, 35.5, 25.5))
    np.testing.assert_array_equal(result.patches[0], image[10:26, 20:36])
    assert result.patches.dtype == np.float32
    assert result.clipped[0] == 0.0


def test_fractions_of_a_pixel_count() -> None:
    """Moving the box by half a pixel moves the window by half a pixel."""
    image = _ramp()
    still, moved = _cut(image, (20, 20, 36, 36)), _cut(image, (20.5, 20, 36.5, 36))
    np.testing.assert_allclose(moved.patches - still.patches, 1.0, atol=1.01)
    assert (moved.patches - still.patches).mean() == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize(("size", "span"), [(4, 6), (40, 75)])
def test_boxes_are_scaled_to_the_patch(size: int, span: int) -> None:
    """A ramp keeps its span whatever the size of the box: the window is scaled, not cut."""
    result = _cut(_ramp(), (30 - size / 2, 30 - size / 2, 30 + size / 2, 30 + size / 2))
    assert result.patches.shape == (1, 16, 16)
    assert np.ptp(result.patches[0][8]) == pytest.approx(span, abs=2)
    assert result.patches.mean() == pytest.approx(90, abs=2)


def test_the_longer_side_and_the_margin_set_the_square() -> None:
    """A 20 by 4 box with margin 1.5 gives a 30 px square."""
    result = _cut(_ramp(), (20, 28, 40, 32), margin=1.5)
    assert np.ptp(result.patches[0][8]) == pytest.approx(60, abs=5)


@pytest.mark.parametrize(
    ("box", "share"),
    [
        ((-8.5, 20, 7.5, 36), 0.5),
        ((-8.5, -8.5, 7.5, 7.5), 0.75),
        ((500, 500, 516, 516), 1.0),
        ((20, 20, 36, 36), 0.0),
    ],
)
def test_clipped_is_the_share_outside(box: tuple[float, float, float, float], share: float) -> None:
    """The border is replicated, and the share of the window outside the image reported."""
    result = _cut(_ramp(), box)
    assert result.clipped[0] == pytest.approx(share, abs=0.02)
    assert np.isfinite(result.patches).all()


def test_border_is_replicated() -> None:
    """Left of the image every row continues its first pixel."""
    image = _ramp()
    patch = _cut(image, (-8.5, 19.5, 7.5, 35.5)).patches[0]
    np.testing.assert_array_equal(patch[:, :8], np.repeat(image[20:36, :1], 8, axis=1))


def test_flags() -> None:
    """Constant windows are flat; boxes below 8 px are tiny."""
    image = np.full((60, 80), 90, np.uint8)
    image[:, 40:] = np.random.default_rng(2).integers(0, 256, (60, 40), np.uint8)
    boxes = np.array([[5.0, 5, 25, 25], [50, 20, 70, 40], [60, 30, 63, 34]])
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    result = cut_windows(image, rotated_boxes(centres, boxes), 16)
    assert result.flat.tolist() == [True, False, False]
    assert result.tiny.tolist() == [False, False, True]


@pytest.mark.parametrize(
    "box",
    [
        (np.nan, 0, 5, 5),
        (0, 0, np.inf, 5),
        (5, 5, 5, 5),
        (9, 9, 3, 3),
        (-1e300, -1e300, 1e300, 1e300),
        (1e18, 1e18, 1e18 + 4096, 1e18 + 4096),
    ],
)
def test_senseless_boxes_give_finite_windows(box: tuple[float, float, float, float]) -> None:
    """NaN, empty, inverted and astronomical boxes give a finite patch of the right size."""
    with np.errstate(all="ignore"):
        result = _cut(_ramp(), box)
    assert result.patches.shape == (1, 16, 16)
    assert np.isfinite(result.patches).all()
    assert 0.0 <= result.clipped[0] <= 1.0


def test_numbers_that_are_not_finite_are_flagged() -> None:
    """A detection without a place has a zero patch, flat and wholly clipped."""
    result = cut_windows(_ramp(), np.array([[np.nan, 4.0, 8, 8, 0]]), 16)
    assert (result.patches == 0).all()
    assert (result.flat[0], result.clipped[0]) == (True, 1.0)


def test_an_image_of_one_pixel() -> None:
    """An image of one pixel gives constant windows, flat."""
    result = _cut(np.full((1, 1), 200, np.uint8), (0, 0, 40, 40))
    np.testing.assert_array_equal(result.patches, np.full((1, 16, 16), 200, np.float32))
    assert result.flat[0]


def test_no_detections() -> None:
    """No detection gives no window."""
    result = cut_windows(_ramp(), np.zeros((0, 5)), 16)
    assert result.patches.shape == (0, 16, 16)
    assert len(result.flat) == len(result.clipped) == len(result.tiny) == 0


def _smooth(side: int = 120) -> np.ndarray:
    noise = np.random.default_rng(11).integers(0, 256, (side // 8, side // 8)).astype(np.uint8)
    return np.asarray(cv2.resize(noise, (side, side), interpolation=cv2.INTER_CUBIC))


def _turn(places: np.ndarray, angle: float) -> np.ndarray:
    return np.column_stack([places[:, :4], places[:, 4] + angle])


@pytest.mark.parametrize("quarter", [1, 2, 3, -1])
def test_a_quarter_turn_turns_the_window(quarter: int) -> None:
    """Rows run along the angle, +x towards +y: a window turned by 90 degrees is the upright one turned."""
    image, place = _smooth(), np.array([[59.5, 50.5, 24.0, 10.0, 0.0]])
    upright = cut_windows(image, place, 24, 1.0).patches[0]
    turned = cut_windows(image, _turn(place, quarter * np.pi / 2), 24, 1.0).patches[0]
    np.testing.assert_allclose(turned, np.rot90(upright, quarter), atol=1.0)


@pytest.mark.parametrize("angle", [0.3, -1.1, 2.7])
@pytest.mark.parametrize("size", [20.0, 60.0])
def test_a_turned_target_looks_as_the_upright_one(angle: float, size: float) -> None:
    """Turning image and target together gives the same window, enlarged or shrunk."""
    image = _smooth()
    # A positive angle of getRotationMatrix2D turns from +x towards -y.
    matrix = cv2.getRotationMatrix2D((59.5, 59.5), -np.degrees(angle), 1.0)
    turned = cv2.warpAffine(image, matrix, (120, 120), flags=cv2.INTER_CUBIC)
    place = np.array([[59.5, 59.5, size, size / 2, 0.0]])
    before = cut_windows(image, place, 32, 1.0).patches[0]
    after = cut_windows(turned, _turn(place, angle), 32, 1.0).patches[0]
    assert np.abs(before - after).mean() < 3.0
    assert np.abs(before - cut_windows(turned, place, 32, 1.0).patches[0]).mean() > 15.0


@pytest.mark.parametrize(("x", "share"), [(30.0, 0.0), (-0.5, 0.5), (-500.0, 1.0)])
def test_clipped_of_turned_windows(x: float, share: float) -> None:
    """The share outside is reported for rotated windows too, and the patch stays finite."""
    result = cut_windows(_ramp(), np.array([[x, 30.0, 16.0, 16.0, 0.7]]), 16, 1.0)
    assert result.clipped[0] == pytest.approx(share, abs=0.03)
    assert np.isfinite(result.patches).all()


@pytest.mark.parametrize("angle", [0.0, 0.8, 1e9, -1e300])
def test_huge_windows(angle: float) -> None:
    """A target of 4000 px gives a finite window of the right size, in a small image and in a large one."""
    large = np.asarray(cv2.resize(_smooth(), (4000, 4000)))
    for image in (_ramp(), large):
        middle = np.array(image.shape[::-1]) / 2
        result = cut_windows(image, np.array([[*middle, 4000.0, 4000.0, angle]]), 32, 1.0)
        assert result.patches.shape == (1, 32, 32)
        assert np.isfinite(result.patches).all()
        assert not result.flat[0]


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_target_of_one_pixel(angle: float) -> None:
    """A 1x1 target is enlarged, and flagged as tiny."""
    result = cut_windows(_ramp(), np.array([[20.0, 20.0, 1.0, 1.0, angle]]), 16)
    assert result.tiny[0]
    assert np.isfinite(result.patches).all()


def _in_two_steps(image: np.ndarray, x: float, y: float, side: int, patch: int) -> np.ndarray:
    """The square between the pixels, then its scaled copy, without any rounding."""
    height, width = image.shape
    left, top = x - (side - 1) / 2, y - (side - 1) / 2
    columns = np.clip(np.floor(left) + np.arange(side + 1), 0, width - 1).astype(int)
    rows = np.clip(np.floor(top) + np.arange(side + 1), 0, height - 1).astype(int)
    square = image[np.ix_(rows, columns)].astype(np.float64)
    square = square[:, :-1] * (1 - left % 1) + square[:, 1:] * (left % 1)
    square = square[:-1] * (1 - top % 1) + square[1:] * (top % 1)
    interpolation = cv2.INTER_AREA if side > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(square, (patch, patch), interpolation=interpolation))


@pytest.mark.parametrize("side", [1, 7, 16, 17, 40, 63, 100])
def test_a_square_is_shifted_and_scaled_and_only_then_rounded(side: int) -> None:
    """A patch is within half a grey level of both steps one by one, between pixels and beyond borders."""
    image = np.random.default_rng(1).integers(0, 256, (120, 160), np.uint8)
    middles = np.random.default_rng(side).uniform((-10, -10), (170, 130), (30, 2))
    boxes = np.column_stack([middles, np.full((30, 2), float(side)), np.zeros(30)])
    patches = cut_windows(image, boxes, 16, 1.0).patches
    expected = np.stack([_in_two_steps(image, x, y, side, 16) for x, y in middles.tolist()])
    assert np.abs(patches - expected).max() < 0.51
