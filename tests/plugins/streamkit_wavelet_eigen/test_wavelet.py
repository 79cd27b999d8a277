"""The batch transform is PyWavelets' periodized transform, and its inverse reconstructs the image."""

import numpy as np
import pytest
import pywt

from streamkit_wavelet_eigen.wavelet import (
    decompose,
    inverse_matrix,
    reconstruct,
    transform_matrix,
)

# What `decompose` returns, by band.
LL, LH, HL, HH = np.s_[:, 0, :, 0], np.s_[:, 1, :, 0], np.s_[:, 0, :, 1], np.s_[:, 1, :, 1]
WAVELETS = pywt.wavelist(kind="discrete")


def _patches(count: int, height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, height, width)).astype(np.float32)


@pytest.mark.parametrize("wavelet", ["haar", "db8", "sym5", "coif2", "db20", "bior4.4", "rbio2.2"])
@pytest.mark.parametrize(("height", "width"), [(32, 32), (64, 64), (16, 48), (2, 8)])
def test_sub_bands_equal_pywavelets(wavelet: str, height: int, width: int) -> None:
    """All four bands are those of pywt.dwt2 in periodization mode, within 1e-3."""
    given = _patches(5, height, width)
    low, (horizontal, vertical, diagonal) = pywt.dwt2(
        given.astype(np.float64), wavelet, mode="periodization", axes=(1, 2)
    )
    bands = decompose(given, wavelet)
    for ours, theirs in (
        (bands[LL], low),
        (bands[LH], horizontal),
        (bands[HL], vertical),
        (bands[HH], diagonal),
    ):
        assert ours.dtype == np.float32
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_every_wavelet_reconstructs() -> None:
    """Each discrete wavelet of PyWavelets gives every patch back within 1e-2 grey levels."""
    given = _patches(7, 32, 48, seed=3)
    assert len(WAVELETS) > 100
    for wavelet in WAVELETS:
        found = reconstruct(decompose(given, wavelet), wavelet)
        np.testing.assert_allclose(found, given, atol=1e-2, err_msg=wavelet)


def test_the_inverse_is_that_of_pywavelets() -> None:
    """Any coefficients, not only those of an image, are inverted as pywt.idwt2 does."""
    bands = (_patches(2, 32, 32, seed=5) - 128.0).reshape(2, 2, 16, 2, 16)
    smooth, *details = (bands[band].astype(float) for band in (LL, LH, HL, HH))
    for wavelet in WAVELETS:
        if wavelet != "dmey":
            theirs = pywt.idwt2((smooth, tuple(details)), wavelet, mode="periodization", axes=(1, 2))
            np.testing.assert_allclose(reconstruct(bands, wavelet), theirs, atol=1e-2, err_msg=wavelet)


@pytest.mark.parametrize("wavelet", ["db8", "sym4", "coif3", "haar"])
def test_the_inverse_of_an_orthogonal_wavelet_is_its_transpose(wavelet: str) -> None:
    """To the rounding of float32."""
    np.testing.assert_allclose(inverse_matrix(wavelet, 32), transform_matrix(wavelet, 32).T, atol=1e-7)


def test_sub_bands_are_views() -> None:
    """Writing a sub-band changes the coefficients that are reconstructed."""
    bands = decompose(_patches(2, 16, 16), "haar")
    for band in (bands[LH], bands[HL], bands[HH]):
        band[...] = 0.0
    smooth = reconstruct(bands, "haar")
    np.testing.assert_allclose(smooth[:, ::2, ::2], smooth[:, 1::2, 1::2], atol=1e-3)


def test_empty_batch() -> None:
    """No patch is no coefficient, not an error."""
    assert reconstruct(decompose(_patches(0, 8, 8))).shape == (0, 8, 8)


@pytest.mark.parametrize("length", [0, 1, 31])
def test_odd_or_empty_sides_are_refused(length: int) -> None:
    """The periodized matrix is orthogonal for even lengths only; others are refused with the length."""
    with pytest.raises(ValueError, match=f"even and at least 2, got {length}"):
        transform_matrix("db8", length)


@pytest.mark.parametrize("wavelet", ["db99", "morl", "", "DB8"])
def test_other_wavelets_are_refused(wavelet: str) -> None:
    """Continuous and unknown wavelets are refused by name."""
    with pytest.raises(ValueError, match=f'no discrete wavelet "{wavelet}"'):
        transform_matrix(wavelet, 32)


def test_matrix_is_read_only() -> None:
    """The cached matrix cannot be changed by one caller for all others."""
    with pytest.raises(ValueError, match="read-only"):
        transform_matrix("db8", 32)[0, 0] = 1.0
