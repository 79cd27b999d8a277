"""Reading rotated windows."""

import cv2
import numpy as np
import pytest

from streamkit_tracker.appearance.eigen_template import EigenSettings, EigenTemplate, normalise
from streamkit_tracker.appearance.frame_crops import MIDDLE_GREY
from streamkit_tracker.appearance.template_comparison import template_distances
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.window_geometry import unit_grid


def ramp(height: int = 80, width: int = 100) -> np.ndarray:
    """Brightness 2 x + y, exact under linear interpolation."""
    rows, columns = np.mgrid[:height, :width]
    return np.clip(2 * columns + 0.5 * rows, 0, 255).astype(np.uint8)


def sampler_on(image: np.ndarray) -> WindowSampler:
    """A sampler that looks at an image."""
    sampler = WindowSampler()
    sampler.set_frame(image)
    return sampler


def test_an_upright_window_of_the_patch_size_is_the_image_itself():
    """Length and width equal to the patch, no angle: samples fall on pixel centres."""
    image = np.random.default_rng(0).integers(0, 255, (60, 60)).astype(np.uint8)
    window = np.array([[29.5, 24.5, 16.0, 16.0, 0.0]])
    patch = sampler_on(image).sample(window, (16, 16))[0].reshape(16, 16) + MIDDLE_GREY
    np.testing.assert_allclose(patch, image[17:33, 22:38], atol=1e-3)


def test_a_turned_window_reads_along_its_angle():
    """Samples of a rotated window agree with the image's analytic brightness."""
    image = ramp()
    angle = 0.6
    window = np.array([[40.0, 40.0, 20.0, 12.0, angle]])
    patch = sampler_on(image).sample(window, (8, 8))[0].reshape(8, 8) + MIDDLE_GREY
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    x = 40 + 20 * steps[None] * np.cos(angle) - 12 * steps[:, None] * np.sin(angle)
    y = 40 + 20 * steps[None] * np.sin(angle) + 12 * steps[:, None] * np.cos(angle)
    np.testing.assert_allclose(patch, 2 * x + 0.5 * y, atol=1.0)


def test_windows_far_apart_read_the_same_as_one_by_one():
    """One part that holds windows far from each other gives the same pixels as a part for each."""
    image = cv2.GaussianBlur(
        np.random.default_rng(1).integers(0, 255, (200, 300)).astype(np.uint8), (0, 0), 2
    )
    windows = np.array([[20.0, 20.0, 18.0, 12.0, 0.4], [280.0, 180.0, 20.0, 10.0, -0.7]])
    together = sampler_on(image).sample(windows, (12, 12)).copy()
    alone = [sampler_on(image).sample(window[None], (12, 12))[0].copy() for window in windows]
    np.testing.assert_allclose(together, np.stack(alone), atol=0.2)


def test_places_far_apart_are_cut_out_each_by_itself():
    """Groups of windows read the same in parts of the frame as each alone, also over the frame's edge."""
    image = cv2.GaussianBlur(
        np.random.default_rng(3).integers(0, 255, (400, 600)).astype(np.uint8), (0, 0), 2
    )
    sampler = sampler_on(image)
    windows = np.array(
        [[20.0, 2, 18, 12, 0.4], [25, 4, 18, 12, 0.1], [598, 380, 20, 10, -0.7], [590, 396, 20, 30, 1.0]]
    )
    crops = sampler.crop(windows, factor=1, groups=2)
    assert crops.quads.size < image.size / 4
    together = sampler.sample(windows, (12, 12), crops=crops).copy()
    alone = [sampler.sample(window[None], (12, 12))[0].copy() for window in windows]
    np.testing.assert_allclose(together, np.stack(alone), atol=0.01)


def test_large_windows_are_averaged_before_they_are_sampled():
    """A window ten times the patch is shrunk first, so that noise averages out instead of aliasing."""
    generator = np.random.default_rng(2)
    image = np.clip(128 + 40 * generator.standard_normal((400, 400)), 0, 255).astype(np.uint8)
    window = np.array([200.0, 200.0, 320.0, 320.0, 0.0])
    factor = shrink_factor(window, (32, 32), image.shape)
    patch = sampler_on(image).sample(window[None], (32, 32), factor)[0]
    assert factor == 10
    assert patch.std() < 40 / 5


@pytest.mark.parametrize("centre", [(-500.0, 40.0), (50.0, 4000.0), (1e6, -1e6)])
def test_a_window_outside_repeats_the_border(centre: tuple[float, float]):
    """Outside the image its edge goes on; nothing raises and nothing is NaN."""
    window = np.array([[*centre, 20.0, 20.0, 0.3]])
    patch = sampler_on(ramp()).sample(window, (8, 8))
    assert np.isfinite(patch).all()


def test_nan_windows_are_refused():
    """A NaN in a map would be read as pixel 0 without a word; it is an error instead."""
    with pytest.raises(ValueError, match="finite windows"):
        sampler_on(ramp()).sample(np.array([[np.nan, 1, 2, 3, 0]]), (8, 8))


def test_colour_images_are_refused():
    """The sampler reads brightness only."""
    with pytest.raises(ValueError, match=r"grey image.*\(4, 4, 3\)"):
        WindowSampler().set_frame(np.zeros((4, 4, 3), np.uint8))


@pytest.mark.parametrize("patch", [(32, 32), (20, 12)])
def test_windows_are_compared_as_their_patches_are(patch: tuple[int, int]):
    """Distances read straight from the frame are those of the sampled patches, for each template its own."""
    random = np.random.default_rng(4)
    sampler = WindowSampler()
    sampler.set_frame(random.integers(0, 256, (120, 160), dtype=np.uint8))
    windows = np.empty((2, 40, 5))
    windows[..., :2] = random.uniform(30, 90, (2, 40, 2))
    windows[..., 2:] = [30, 20, 0.4]
    patches = sampler.sample(windows.reshape(-1, 5), patch).reshape(2, 40, -1).copy()
    templates = [
        EigenTemplate(patches[0, 3], EigenSettings(4)),
        EigenTemplate(patches[1, 7], EigenSettings(4)),
    ]
    for sample in patches[0, 10:20]:
        templates[0].update(sample)
    crops = sampler.crop(windows.reshape(-1, 5), 1, groups=2)
    rows = np.stack([template.rows for template in templates])
    constants = np.stack([template.constants for template in templates])
    distances, first = np.empty((2, 40)), np.empty((2, patch[0] * patch[1]), np.float32)
    grid = unit_grid(patch)
    template_distances(
        crops.quads, crops.parts, crops.factor, windows, grid, rows, constants, distances, first
    )
    for template, some, found in zip(templates, patches, distances, strict=True):
        centred, basis = normalise(some) - template.mean, template.rows[:4]
        plain = (centred**2).sum(axis=1) - ((centred @ basis.T) ** 2).sum(axis=1)
        np.testing.assert_allclose(found, plain / some.shape[1], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(first, patches[:, 0], atol=1e-2)
    assert distances[1].argmin() == 7
