"""Tables 2 and 4: centre error of the tracker with an eigenspace from a target's training images."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.experiments.protocol import Split
from streamkit_wavelet_eigen.experiments.published import RUNS
from streamkit_wavelet_eigen.experiments.results import Figure, figure_of
from streamkit_wavelet_eigen.experiments.scene import TARGET_SIDE, Scene, make_scene
from streamkit_wavelet_eigen.gallery import empty_gallery
from streamkit_wavelet_eigen.learner import learn_space
from streamkit_wavelet_eigen.model_file import Model, save_model
from streamkit_wavelet_eigen.recipe import Recipe

# The published method on 32 px windows in 16 blocks, chosen before the run and not fitted to the tables.
RECIPE = Recipe(patch=32, blocks=4, components=10)
FIRST_SCENE = 4000

# Follows a target: the frames uint8[n, h, w], the model file, the target's centre in the first frame (px) and
# its side (px) to float64[n, 2], its reported centre in each frame. It is called in child processes.
Follow: TypeAlias = Callable[[NDArray[np.uint8], Path, NDArray[np.float64], int], NDArray[np.float64]]


def tracking_errors(splits: Sequence[Split], follow: Follow, runs: int = RUNS[-1]) -> list[float]:
    """Mean centre error of each run over its 24 frames, px.

    Run r uses target r and split r, modulo their numbers: the space is learnt from that target's training
    images alone, the sequence shows its test images. The window is given in the first frame.
    """
    found = []
    with tempfile.TemporaryDirectory(prefix="streamkit-experiments-") as folder:
        for run in range(runs):
            split = splits[run % len(splits)]
            names = sorted(set(split.training.labels))
            name = names[run % len(names)]
            training, test = (
                sample.images[[label == name for label in sample.labels]]
                for sample in (split.training, split.test)
            )
            model = Path(folder) / f"{run}.npz"
            save_model(Model(learn_space(_halved(training), RECIPE), empty_gallery(RECIPE.patch)), model)
            found.append(centre_error(make_scene(test, FIRST_SCENE + run), model, follow))
    return found


def by_runs(errors: Sequence[float]) -> list[Figure]:
    """The mean over the first n runs, n = 10, 20 ... 100."""
    return [figure_of(errors[:count]) for count in RUNS if count <= len(errors)]


def centre_error(scene: Scene, model: Path, follow: Follow) -> float:
    """Mean distance between the tracked and the true centre of the target, px."""
    found = follow(scene.frames, model, scene.centres[0], TARGET_SIDE)
    return float(np.mean(np.hypot(*(found - scene.centres).T)))


def _halved(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Means of 2x2 pixels: 64 px images as 32 px windows."""
    count, height, width = images.shape
    quarters = images.reshape(count, height // 2, 2, width // 2, 2)
    return np.asarray(quarters.mean(axis=(2, 4)), np.float32)
