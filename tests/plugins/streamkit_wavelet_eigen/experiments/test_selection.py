"""The choice depends on training images alone, and the chosen candidate is tested once."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.experiments.recognition import RAW, choose
from streamkit_wavelet_eigen.experiments.splits import DatabaseSplit, splits
from streamkit_wavelet_eigen.recipe import Recipe

CANDIDATES = {
    "few": Recipe(64, RAW, components=1),
    "more": Recipe(64, RAW, components=6),
    "Fisher": Recipe(64, RAW, components=6, discriminative=True),
}


@pytest.fixture(scope="module")
def parts() -> list[DatabaseSplit]:
    """Two splits of four made-up targets, six noisy images each, four of them for training."""
    generator = np.random.default_rng(0)
    coarse = generator.integers(20, 230, (4, 1, 6, 6)).astype(np.uint8)
    clean = np.stack(
        [[cv2.resize(one, (64, 64), interpolation=cv2.INTER_CUBIC) for one in row] for row in coarse]
    )
    noisy = np.repeat(clean, 6, axis=1) + generator.normal(0, 20, (4, 6, 64, 64))
    return list(splits(np.clip(noisy, 0, 255).astype(np.uint8), 4, 2))


def test_each_split_chooses_one_candidate(parts: list[DatabaseSplit]) -> None:
    """As many choices as splits, a figure for each candidate, and one rate for each chosen one."""
    found = choose(parts, 4, CANDIDATES)
    assert sum(found["chosen"].values()) == 2
    assert set(found["chosen"]) <= set(CANDIDATES)
    assert {name: figure["n"] for name, figure in found["inner"].items()} == dict.fromkeys(CANDIDATES, 2)
    assert found["outer"] == {"mean": 100.0, "deviation": 0.0, "n": 2}


def test_test_images_have_no_part_in_the_selection(parts: list[DatabaseSplit]) -> None:
    """With noise for test images the choice is the same, and only the last figure falls."""
    noise = np.random.default_rng(1)
    spoilt = [
        replace(
            part, test=replace(part.test, patches=noise.integers(0, 256, part.test.patches.shape, np.uint8))
        )
        for part in parts
    ]
    before, after = choose(parts, 4, CANDIDATES), choose(spoilt, 4, CANDIDATES)
    assert (after["chosen"], after["inner"]) == (before["chosen"], before["inner"])
    assert after["outer"]["mean"] < before["outer"]["mean"]
