"""The compared methods, as recipes of this package."""

from dataclasses import replace

import numpy as np

from streamkit_wavelet_eigen.experiments.protocol import Split
from streamkit_wavelet_eigen.gallery import Gallery, Recogniser, accuracy, prepare_gallery
from streamkit_wavelet_eigen.learner import learn_space
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing
from streamkit_wavelet_eigen.recipe import PRESETS, Basis, Metric, Recipe, Views

RAW = Preprocessing(Mode.RAW)
PROPOSED = "paper chain, modular PCA (preset paper)"
TRADITIONAL = "raw pixels, whole-picture PCA 40 (traditional)"
MODULAR = "raw pixels, modular PCA (preset modular)"
BEST = "approximation, virtual views, Fisher (preset recognition)"

METHODS: dict[str, Recipe] = {
    PROPOSED: PRESETS["paper"],
    "paper chain, whole-picture PCA 40": Recipe(64, components=40),
    "db8 denoising only, modular PCA": replace(PRESETS["paper"], preprocessing=Preprocessing(Mode.DENOISE)),
    TRADITIONAL: Recipe(64, RAW, components=40),
    MODULAR: PRESETS["modular"],
    "raw pixels, modular PCA 5, one distance": replace(
        PRESETS["modular"], components=5, metric=Metric.EUCLIDEAN
    ),
    "raw pixels, sub-pattern PCA": replace(PRESETS["modular"], basis=Basis.PER_BLOCK),
    "raw pixels, whole-picture PCA 40, Fisher": Recipe(64, RAW, components=40, discriminative=True),
    BEST: PRESETS["recognition"],
}

# Candidates of model selection.
CANDIDATES: dict[str, Recipe] = {
    "modular": PRESETS["modular"],
    "no views, 40": replace(PRESETS["recognition"], views=Views.NONE, components=40),
    "shifted, 60": replace(PRESETS["recognition"], views=Views.SHIFTED),
    "mirrored, 40": replace(PRESETS["recognition"], components=40),
    "mirrored, 60": PRESETS["recognition"],
    "mirrored, 100": replace(PRESETS["recognition"], components=100),
}


def recognition_rate(recipe: Recipe, split: Split) -> float:
    """Percent of the test images whose nearest training image is of the same target."""
    training, test = split.training, split.test
    if len(set(training.labels)) < 2:
        # A Fisher step needs two targets; with one every answer is right.
        recipe = replace(recipe, discriminative=False)
    space = learn_space(training.images.astype(np.float32), recipe, training.labels)
    recogniser = Recogniser(space, prepare_gallery(Gallery(training.images, training.labels), recipe))
    matches = recogniser.recognise(space.embed(test.images.astype(np.float32)))
    return 100.0 * accuracy(matches.labels, test.labels)
