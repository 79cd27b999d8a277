"""Tests of scaling images."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.geometry.scaling import scaling_homography
from streamkit_video.pixel_formats import FORMATS, convert, image_height, supports_size
from streamkit_video.videoscale import ScaleMethod, scale_image


def blob(width: int, height: int, x: float, y: float) -> np.ndarray:
    """A soft bright spot on grey, BGR."""
    rows, columns = np.mgrid[:height, :width]
    spot = 150.0 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 50.0)
    return np.repeat(np.rint(60.0 + spot).astype(np.uint8)[:, :, None], 3, axis=2)


def spot_place(grey: np.ndarray) -> np.ndarray:
    """The centre of the spot."""
    weights = np.maximum(grey.astype(float) - np.median(grey) - 5.0, 0.0)
    rows, columns = np.mgrid[: grey.shape[0], : grey.shape[1]]
    return np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()


@pytest.mark.parametrize("method", list(ScaleMethod))
@pytest.mark.parametrize("size", [(60, 40), (180, 140), (120, 160)])
def test_the_homography_says_where_pixels_go(method: ScaleMethod, size: tuple[int, int]) -> None:
    """A spot is scaled to where `scaling_homography` maps it."""
    scaled = scale_image(blob(120, 80, 71.0, 33.0), "BGR", size, method)
    expected = cv2.perspectiveTransform(np.array([[[71.0, 33.0]]]), scaling_homography((120, 80), size))[0, 0]
    # Nearest takes one of two equally near pixels when halving: a quarter pixel of the result.
    tolerance = 0.27 if method is ScaleMethod.NEAREST else 0.15
    np.testing.assert_allclose(spot_place(scaled[:, :, 0]), expected, atol=tolerance)


@pytest.mark.parametrize("pixel_format", FORMATS)
def test_formats_scale_alike(pixel_format: str) -> None:
    """Scaling in any format shows what scaling in BGR shows."""
    image = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 256, (80, 120, 3), dtype=np.uint8), (0, 0), 6
    )
    here = scale_image(convert(image, "BGR", pixel_format), pixel_format, (60, 40), ScaleMethod.AREA)
    there = convert(scale_image(image, "BGR", (60, 40), ScaleMethod.AREA), "BGR", pixel_format)
    assert here.shape == there.shape
    assert np.abs(here.astype(int) - there).max() <= 3


@settings(max_examples=60)
@given(
    before=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    after=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    pixel_format=st.sampled_from(FORMATS),
    method=st.sampled_from(ScaleMethod),
)
def test_any_size_to_any_size(
    before: tuple[int, int], after: tuple[int, int], pixel_format: str, method: ScaleMethod
) -> None:
    """Flat stays flat in every size a format has."""
    if not (supports_size(pixel_format, *before) and supports_size(pixel_format, *after)):
        return
    data = convert(np.full((before[1], before[0], 3), 90, np.uint8), "BGR", pixel_format)
    scaled = scale_image(data, pixel_format, after, method)
    assert (scaled.shape[1], image_height(scaled, pixel_format)) == after
    assert set(np.unique(scaled)) <= set(np.unique(data))
