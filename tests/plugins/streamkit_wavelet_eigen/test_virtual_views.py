"""Virtual views move a window a little and keep what it shows."""

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Mode, Preprocessing, Views
from streamkit_wavelet_eigen.virtual_views import prepared_views, view_count, virtual_views


def _windows(count: int = 3, side: int = 64) -> np.ndarray:
    coarse = np.random.default_rng(3).integers(0, 256, (count, 8, 8)).astype(np.float32)
    return np.stack([cv2.resize(one, (side, side), interpolation=cv2.INTER_CUBIC) for one in coarse])


@pytest.mark.parametrize("views", list(Views))
def test_the_windows_themselves_come_first(views: Views) -> None:
    """View by view, the given windows first, unchanged."""
    given = _windows()
    result = list(virtual_views(given, views))
    assert len(result) == view_count(views)
    assert all(view.shape == (3, 64, 64) and view.dtype == np.float32 for view in result)
    np.testing.assert_array_equal(result[0], given)


def test_shifts_are_a_thirty_second_of_the_side() -> None:
    """The second view of a 64 px window lies 2 px to the right, the fourth 2 px down."""
    given = _windows(1)
    result = list(virtual_views(given, Views.SHIFTED))
    np.testing.assert_allclose(result[1][:, :, 2:], given[:, :, :-2], atol=1e-3)
    np.testing.assert_allclose(result[3][:, 2:], given[:, :-2], atol=1e-3)


def test_every_view_differs_and_resembles() -> None:
    """Each is another image, and nearer to its own window than to the others."""
    given = _windows()
    for view in list(virtual_views(given, Views.SHIFTED))[1:]:
        apart = np.abs(view[:, None] - given[None]).mean(axis=(2, 3))
        assert apart.argmin(axis=1).tolist() == [0, 1, 2]
        assert apart.min() > 0


def test_every_second_view_is_mirrored() -> None:
    """Left and right change places in a mirrored view."""
    result = list(virtual_views(_windows(), Views.MIRRORED))
    for view, mirrored in zip(result[::2], result[1::2], strict=True):
        np.testing.assert_array_equal(mirrored, view[:, :, ::-1])


def test_views_are_prepared_one_by_one() -> None:
    """Preparing view after view gives what preparing all together gives."""
    how = Preprocessing(Mode.RAW, approximation=2)
    together = prepare(np.concatenate(list(virtual_views(_windows(), Views.SHIFTED))), how)
    np.testing.assert_allclose(prepared_views(_windows(), Views.SHIFTED, how), together, atol=1e-3)


def test_no_window_has_no_view() -> None:
    """An empty batch stays empty."""
    none = np.zeros((0, 8, 8), np.float32)
    assert prepared_views(none, Views.MIRRORED, Preprocessing(Mode.RAW)).shape == (0, 8, 8)
