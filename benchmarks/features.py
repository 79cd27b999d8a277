"""Features: time to prepare and embed windows, next to the same steps one by one and to HOG.

Run it:  python benchmarks/features.py
Times are of one thread's work (its processor time), medians of five; linear algebra is held to one thread.
The peers are PyWavelets and OpenCV patch by patch, and scikit-image's HOG (extra `experiments`).
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import cv2
import numpy as np
import pywt

from streamkit import Detections, Frame, raw_video_caps
from streamkit.testing import Harness
from streamkit_wavelet_eigen.appearance import AppearanceSettings, SpaceLearner
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, learn_space
from streamkit_wavelet_eigen.gallery import Gallery, Recogniser
from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import PRESETS, Mode, Preprocessing, Recipe

THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ROUNDS = 5
BATCH = 128
TARGETS = 20


def seconds(action: Callable[[], object]) -> float:
    """Median of five runs, each as many calls as fill 0.1 s."""
    action()
    began = time.thread_time()
    action()
    calls = max(int(0.1 / max(time.thread_time() - began, 1e-6)), 1)
    times = []
    for _ in range(ROUNDS):
        began = time.thread_time()
        for _ in range(calls):
            action()
        times.append((time.thread_time() - began) / calls)
    return statistics.median(times)


def windows(count: int, side: int, seed: int = 0) -> np.ndarray:
    """Smooth random images with a little noise."""
    generator = np.random.default_rng(seed)
    coarse = generator.integers(20, 230, (count, 6, 6)).astype(np.float32)
    smooth = np.stack([cv2.resize(one, (side, side), interpolation=cv2.INTER_CUBIC) for one in coarse])
    return np.clip(np.rint(smooth + generator.normal(0, 5, smooth.shape)), 0, 255).astype(np.float32)


def textbook(patch: np.ndarray) -> np.ndarray:
    """The five published steps on one patch with PyWavelets and OpenCV."""
    low, details = pywt.dwt2(patch, "db8", mode="periodization")
    span = float(low.max() - low.min()) or 1.0
    grey = np.rint((low - low.min()) / span * 255).astype(np.uint8)
    low = cv2.equalizeHist(grey) / np.float32(255.0) * span + low.min()
    limit = np.median(np.abs(details[2])) / 0.6745 * np.sqrt(2 * np.log(patch.size))
    details = tuple(pywt.threshold(band, limit, "soft") for band in details)
    restored = pywt.idwt2((low, details), "db8", mode="periodization")
    return np.asarray(cv2.equalizeHist(np.rint(np.clip(restored, 0, 255)).astype(np.uint8)))


def preparing(side: int) -> None:
    """Microseconds per patch, paper mode, next to the textbook path and HOG."""
    from skimage.feature import hog

    given = windows(BATCH, side)
    ours = seconds(lambda: prepare(given, Preprocessing())) / BATCH
    denoise = seconds(lambda: prepare(given, Preprocessing(Mode.DENOISE))) / BATCH
    peer = seconds(lambda: [textbook(patch) for patch in given]) / BATCH
    gradients = seconds(lambda: [hog(patch) for patch in given[:16]]) / 16
    print(
        f"prepare {side}x{side}, batch {BATCH}: paper {ours * 1e6:.1f} us   denoise {denoise * 1e6:.1f} us   "
        f"patch by patch {peer * 1e6:.0f} us ({peer / ours:.1f}x)   HOG {gradients * 1e6:.0f} us"
    )


def embedding(name: str, recipe: Recipe) -> WaveletEigenSpace:
    """Microseconds per patch of a whole embedding."""
    training = windows(60, recipe.patch, 1)
    labels = [f"{number % 6}" for number in range(60)]
    space = learn_space(training, recipe, labels)
    given = windows(BATCH, recipe.patch)
    print(f"embed {name:22s} {seconds(lambda: space.embed(given)) / BATCH * 1e6:6.1f} us per window")
    return space


def recognising(space: WaveletEigenSpace) -> None:
    """Milliseconds to recognise 20 targets in a gallery of 200 windows."""
    gallery = windows(200, space.recipe.patch, 2).astype(np.uint8)
    labels = tuple(f"{number % 40}" for number in range(200))
    recogniser = Recogniser(space.recipe, Gallery(gallery, labels))
    vectors = space.embed(windows(TARGETS, space.recipe.patch, 3))
    taken = seconds(lambda: recogniser.recognise(vectors, space))
    print(f"recognise {TARGETS} in a gallery of 200: {taken * 1e3:.2f} ms")


def whole_frame(title: str, **properties: object) -> None:
    """Milliseconds waveleteigen needs for a 1080p frame with 20 targets."""
    generator = np.random.default_rng(4)
    image = np.asarray(cv2.resize(windows(1, 256)[0].astype(np.uint8), (1920, 1080)))
    centres = generator.uniform((60, 60), (1860, 1020), (TARGETS, 2))
    halves = generator.uniform(8, 32, (TARGETS, 2))
    ones = np.ones(TARGETS)
    detections = Detections(centres, np.hstack([centres - halves, centres + halves]), ones, ones)
    frame = Frame(image, raw_video_caps("GRAY8", 1920, 1080)).attach(detections)
    with Harness("waveleteigen", **properties) as harness:
        harness.push(frame)
        print(f"frame 1080p, {TARGETS} targets, {title}: {seconds(lambda: harness.push(frame)) * 1e3:.2f} ms")


def learning() -> None:
    """Milliseconds of one update with 32 windows."""
    recipe = Recipe(32)
    learner = SpaceLearner(AppearanceSettings(recipe, batch=32, forgetting=0.95))
    prepared = prepare(windows(32, 32), recipe.preprocessing)
    learner.add(prepared)
    print(f"update with 32 windows of 32x32: {seconds(lambda: learner.add(prepared)) * 1e3:.2f} ms")


def main() -> None:
    """Prints one line for each figure."""
    if os.environ.get("OMP_NUM_THREADS") != "1":
        # The libraries read this when they are loaded, which has happened here already.
        environment = {**os.environ, **THREADS}
        sys.exit(subprocess.run([sys.executable, __file__], env=environment, check=False).returncode)
    cv2.setNumThreads(1)
    preparing(32)
    preparing(64)
    embedding("32 px, paper", Recipe(32))
    for name, recipe in PRESETS.items():
        space = embedding(f"preset {name}", recipe)
    recognising(space)
    learning()
    whole_frame("32 px, paper, learning")
    whole_frame("64 px, paper, learning", patch=64)
    whole_frame("64 px, preset modular", preset="modular")


if __name__ == "__main__":
    main()
