"""Steps 1 to 5 against the textbook path, patch by patch."""

import cv2
import numpy as np
import pytest
import pywt

from streamkit_wavelet_eigen.preprocessing import (
    CHUNK_PIXELS,
    Mode,
    Preprocessing,
    Threshold,
    equalised,
    prepare,
    threshold_details,
)
from streamkit_wavelet_eigen.wavelet import decompose

# What `decompose` returns, by band.
LL, LH, HL, HH = np.s_[:, 0, :, 0], np.s_[:, 1, :, 0], np.s_[:, 0, :, 1], np.s_[:, 1, :, 1]


def _scene(count: int, side: int, seed: int = 1) -> np.ndarray:
    generator = np.random.default_rng(seed)
    coarse = generator.integers(40, 200, (count, 4, 4)).astype(np.float32)
    smooth = np.stack([cv2.resize(patch, (side, side), interpolation=cv2.INTER_CUBIC) for patch in coarse])
    return np.clip(np.rint(smooth + generator.normal(0, 6, smooth.shape)), 0, 255).astype(np.float32)


def _textbook(patch: np.ndarray) -> np.ndarray:
    low, details = pywt.dwt2(patch.astype(np.float64), "db8", mode="periodization")
    span = low.max() - low.min()
    grey = np.rint((low - low.min()) / span * 255).astype(np.uint8)
    low = cv2.equalizeHist(grey) / 255.0 * span + low.min()
    sigma = np.median(np.abs(details[2])) / 0.6745
    limit = sigma * np.sqrt(2 * np.log(patch.size))
    details = tuple(pywt.threshold(band, limit, "soft") for band in details)
    restored = pywt.idwt2((low, details), "db8", mode="periodization")
    return cv2.equalizeHist(np.rint(np.clip(restored, 0, 255)).astype(np.uint8))


def test_paper_mode_is_the_textbook_chain() -> None:
    """The batch gives what dwt2, equalizeHist, soft threshold, idwt2, equalizeHist give one by one."""
    given = _scene(CHUNK_PIXELS // 32**2 + 5, 32)
    ours = prepare(given, Preprocessing())
    theirs = np.stack([_textbook(patch) for patch in given]).astype(np.float32)
    # A coefficient on the edge between two grey levels may round differently in float32 and float64.
    assert np.mean(np.abs(ours - theirs) > 1.0) < 0.002
    assert np.abs(ours - theirs).max() <= 12.0


def test_raw_mode_changes_nothing() -> None:
    """Raw windows pass as they are."""
    given = _scene(3, 32)
    np.testing.assert_array_equal(prepare(given, Preprocessing(Mode.RAW)), given)


def test_denoise_mode_removes_noise_and_keeps_the_scene() -> None:
    """Denoised patches are nearer to the clean scene than the noisy ones, and not equalised."""
    generator = np.random.default_rng(5)
    columns = np.arange(64)
    clean = np.broadcast_to(128 + 60 * np.sin(columns / 9.0), (4, 64, 64)).astype(np.float32)
    noisy = (clean + generator.normal(0, 10, clean.shape)).astype(np.float32)
    for rule in (Threshold.VISU, Threshold.BAYES):
        denoised = prepare(noisy, Preprocessing(Mode.DENOISE, rule))
        assert np.abs(denoised - clean).mean() < 0.7 * np.abs(noisy - clean).mean()


def test_no_threshold_in_denoise_mode_is_identity() -> None:
    """Transform and inverse alone give the patch back within 1e-2."""
    given = _scene(3, 32)
    np.testing.assert_allclose(prepare(given, Preprocessing(Mode.DENOISE, Threshold.NONE)), given, atol=1e-2)


def test_visu_threshold_is_soft_and_leaves_ll() -> None:
    """Details shrink by sigma * sqrt(2 ln N) as pywt.threshold does; LL is untouched."""
    bands = decompose(_scene(6, 32))
    shrunk = threshold_details(bands, Threshold.VISU)
    np.testing.assert_array_equal(shrunk[LL], bands[LL])
    for index in range(6):
        limit = np.median(np.abs(bands[HH][index])) / 0.6745 * np.sqrt(2 * np.log(32 * 32))
        for ours, before in (
            (shrunk[LH], bands[LH]),
            (shrunk[HL], bands[HL]),
            (shrunk[HH], bands[HH]),
        ):
            np.testing.assert_allclose(ours[index], pywt.threshold(before[index], limit, "soft"), atol=1e-3)


def test_bayes_threshold_follows_each_band() -> None:
    """A band is shrunk by noise variance over clean deviation, each by its own."""
    bands = decompose(_scene(4, 64))
    shrunk = threshold_details(bands, Threshold.BAYES)
    for index in range(4):
        sigma = np.median(np.abs(bands[HH][index])) / 0.6745
        for ours, before in (
            (shrunk[LH], bands[LH]),
            (shrunk[HL], bands[HL]),
        ):
            clean = np.sqrt(max(float(np.mean(before[index] ** 2)) - sigma**2, 0.0))
            limit = sigma**2 / clean if clean > 0 else float(np.abs(before[index]).max())
            np.testing.assert_allclose(ours[index], pywt.threshold(before[index], limit, "soft"), atol=2e-3)


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("value", [0.0, 77.0, 255.0])
def test_constant_window_stays_constant(mode: Mode, value: float) -> None:
    """There is nothing to equalise in a constant window: it comes back as it was."""
    given = np.full((2, 32, 32), value, np.float32)
    np.testing.assert_allclose(prepare(given, Preprocessing(mode)), given, atol=1e-2)


@pytest.mark.parametrize("mode", list(Mode))
def test_extreme_windows_stay_finite_and_in_range(mode: Mode) -> None:
    """Checkerboards, single bright pixels and saturated halves give grey levels 0..255."""
    given = np.zeros((3, 32, 32), np.float32)
    given[0, ::2, ::2] = given[0, 1::2, 1::2] = 255.0
    given[1, 16, 16] = 255.0
    given[2, :, 16:] = 255.0
    for rule in Threshold:
        result = prepare(given, Preprocessing(mode, rule))
        assert np.isfinite(result).all()
        assert result.min() >= 0.0
        assert result.max() <= 255.0


def test_batch_equals_one_by_one() -> None:
    """A patch's result does not depend on its neighbours in the batch."""
    given = _scene(9, 32)
    alone = np.concatenate([prepare(given[index : index + 1], Preprocessing()) for index in range(9)])
    assert np.mean(prepare(given, Preprocessing()) != alone) < 0.002


def test_odd_patch_is_refused_where_a_transform_is_needed() -> None:
    """`check` refuses 31 px windows in paper mode and takes them raw."""
    Preprocessing(Mode.RAW).check((31, 31))
    with pytest.raises(ValueError, match="even"):
        Preprocessing(Mode.PAPER).check((31, 31))


def test_approximation_is_the_low_pass_band() -> None:
    """Each level is PyWavelets' LL over 2, which keeps grey levels, and halves the sides."""
    given = _scene(3, 64)
    low = given.astype(np.float64)
    for level in (1, 2, 3):
        low = pywt.dwt2(low, "db8", mode="periodization", axes=(1, 2))[0] / 2
        how = Preprocessing(Mode.RAW, approximation=level)
        assert how.prepared_size((64, 64)) == low.shape[1:]
        np.testing.assert_allclose(prepare(given, how), low, atol=1e-2)


def test_approximation_follows_the_other_steps() -> None:
    """In paper mode the equalised window is approximated, not the raw one."""
    given = _scene(4, 32)
    equalised = prepare(given, Preprocessing())
    expected = prepare(equalised, Preprocessing(Mode.RAW, approximation=1))
    np.testing.assert_allclose(prepare(given, Preprocessing(approximation=1)), expected, atol=1e-3)


@pytest.mark.parametrize(("side", "levels"), [(32, 6), (24, 4), (32, -1)])
def test_too_many_levels_are_refused(side: int, levels: int) -> None:
    """A side that cannot be halved so often is refused by `check`."""
    with pytest.raises(ValueError, match=r"even|at least 0"):
        Preprocessing(Mode.RAW, approximation=levels).check((side, side))


@pytest.mark.parametrize("levels", [1, 2, 7, 256])
def test_equalised_levels_are_those_of_opencv(levels: int) -> None:
    """Every grey level is the one that cv2.equalizeHist gives, for images of few levels and of many."""
    generator = np.random.default_rng(levels)
    shades, chosen = generator.integers(0, 256, (40, levels)), generator.integers(0, levels, (40, 240))
    patches = np.take_along_axis(shades, chosen, axis=1).reshape(40, 12, 20).astype(np.uint8)
    result = equalised(patches.astype(np.float32))
    np.testing.assert_array_equal(result, np.stack([cv2.equalizeHist(patch) for patch in patches]))


def test_levels_between_are_rounded_and_held_in_range() -> None:
    """Levels are rounded first, and what lies beyond 0 and 255 counts as these."""
    given = np.array([[[-3.0, 0.4, 90.6, 91.2, 255.4, 300.0]]], np.float32)
    rounded = np.array([[[0, 0, 91, 91, 255, 255]]], np.uint8)
    np.testing.assert_array_equal(equalised(given)[0], cv2.equalizeHist(rounded[0]))
