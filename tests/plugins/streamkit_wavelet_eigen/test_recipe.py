"""Recipes refuse what does not fit together; presets are recipes that do."""

from dataclasses import replace

import pytest

from streamkit_wavelet_eigen.recipe import PRESETS, Basis, Mode, Preprocessing, Recipe

RAW = Preprocessing(Mode.RAW)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_fit_together(name: str) -> None:
    """Each passes its own check, and works on the 64 px windows of the published protocol."""
    PRESETS[name].check()
    assert PRESETS[name].patch == 64


@pytest.mark.parametrize(
    ("recipe", "text"),
    [
        (Recipe(30, RAW, blocks=4), "multiple of blocks, got 4"),
        (Recipe(32, RAW, blocks=0), "multiple of blocks, got 0"),
        (Recipe(16, RAW, blocks=4, components=17), "1 to 16, the values of a block, got 17"),
        (Recipe(16, RAW, components=0), "got 0"),
        (Recipe(31), "even"),
        (Recipe(32, RAW, energy=0.0), "energy"),
        (Recipe(32, RAW, energy=float("nan")), "energy"),
        (Recipe(32, RAW, shrinkage=1.5), "shrinkage"),
    ],
)
def test_what_does_not_fit_is_refused(recipe: Recipe, text: str) -> None:
    """The error states the rule and what it got."""
    with pytest.raises(ValueError, match=text):
        recipe.check()


def test_sizes_follow_from_the_settings() -> None:
    """64 px, two low-pass levels and 2 blocks per side make blocks of 8 by 8."""
    recipe = Recipe(64, replace(RAW, approximation=2), 2, Basis.PER_BLOCK)
    assert (recipe.prepared_size, recipe.block_values, recipe.spaces) == ((16, 16), 64, 4)
    assert replace(recipe, basis=Basis.SHARED).spaces == 1
