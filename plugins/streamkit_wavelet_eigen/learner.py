"""Learns a feature space from the windows of a stream, a bounded batch at a time."""

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.eigenspace import learn_eigenspace, update_eigenspace
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace
from streamkit_wavelet_eigen.preprocessing import Preprocessing
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Two windows are the fewest that differ, so the fewest that give an eigenvector.
FIRST_BATCH = 2


class SpaceLearner:
    """Collects prepared windows and makes a new snapshot of the space whenever a batch is full.

    The first space is made as soon as two windows are there, so that a stream has features from its start;
    later ones every `batch` windows. At most `batch` windows are held, and one update is made per call.

    Args:
        patch: side of the square windows in pixels.
        components: most eigenvectors.
        batch: windows per update, at least 2.
        forgetting: weight of the past at each update, 0 < forgetting <= 1.
        preprocessing: how the windows were prepared; written into the snapshots.
        start: a space to go on from, or None.
    """

    def __init__(
        self,
        *,
        patch: int,
        components: int,
        batch: int,
        forgetting: float,
        preprocessing: Preprocessing,
        start: WaveletEigenSpace | None = None,
    ) -> None:
        self.space = start
        self._patch_size = (patch, patch)
        self._components = components
        self._batch = batch
        self._forgetting = forgetting
        self._preprocessing = preprocessing
        self._held: list[NDArray[np.float64]] = []

    def add(self, prepared: FloatBatch) -> WaveletEigenSpace | None:
        """Takes windows float32[n, h, w], and returns the newest space, None before the first.

        Of more windows than the batch has room for, evenly spaced ones are taken: a crowded frame neither
        delays the stream nor counts for more than a batch.
        """
        room = self._batch - len(self._held)
        if len(prepared) > room:
            prepared = prepared[np.linspace(0, len(prepared) - 1, room).round().astype(int)]
        self._held.extend(window.astype(np.float64).ravel() for window in prepared)
        if len(self._held) >= (FIRST_BATCH if self.space is None else self._batch):
            self._learn(np.stack(self._held))
            self._held.clear()
        return self.space

    def _learn(self, vectors: NDArray[np.float64]) -> None:
        if self.space is None:
            values, version = learn_eigenspace(vectors, self._components), 1
        else:
            values = update_eigenspace(self.space.space, vectors, self._components, self._forgetting)
            version = self.space.version + 1
        self.space = WaveletEigenSpace(
            values, self._patch_size, self._components, self._preprocessing, version
        )
