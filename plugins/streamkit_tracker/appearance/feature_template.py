"""Appearance of one target in a feature space that travels with the frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streamkit.geometry.track import FeatureSpace
from streamkit_tracker.appearance.frame_crops import MIDDLE_GREY
from streamkit_tracker.window_geometry import Float32Array

LEARNING_RATE = 0.05


class FeatureTemplate:
    """A target's vector in a feature space: the first one as anchor and a slow mean.

    A space that goes to a new version moves every vector; the anchor and the latest patch are kept and
    embedded again, so that old and new vectors are never compared.

    Args:
        patch: float32[p], grey levels minus 128 of the first window, p = height * width of the space's
            patches.
        space: the feature space of the current frame.

    Attributes:
        textured: whether the first patch has a direction in the feature space at all.
    """

    def __init__(self, patch: Float32Array, space: FeatureSpace) -> None:
        self._anchor_patch = patch.copy()
        self._latest_patch = self._anchor_patch
        self.space = space
        self.anchor = self.mean = np.zeros(0, np.float32)
        self._embed_again()
        self.textured = bool(np.any(self.anchor))

    def follow(self, space: FeatureSpace) -> None:
        """Takes the space of the current frame; embeds again what is kept when its vectors have changed."""
        if space.patch_size == self.space.patch_size:
            is_stale, self.space = space.version != self.space.version, space
            if is_stale:
                self._embed_again()

    def update(self, patch: Float32Array) -> None:
        """Moves the mean a little towards a patch, float32[p]."""
        self._latest_patch = patch.copy()
        vector = embed_rows(self.space, patch[None])[0]
        mixed = (1 - LEARNING_RATE) * self.mean + LEARNING_RATE * vector
        self.mean = unit_rows(mixed[None])[0]

    def _embed_again(self) -> None:
        self.anchor, latest = embed_rows(self.space, np.stack([self._anchor_patch, self._latest_patch]))
        self.mean = unit_rows((self.anchor + latest)[None])[0]

    @staticmethod
    def distances(templates: Sequence[FeatureTemplate], patches: Float32Array) -> Float32Array:
        """Twice one minus the cosine to the nearer of anchor and mean: 0 is a match, 2 unrelated, 4 opposite.

        For unit vectors this is the squared distance, on the same scale as a normalised patch residual. Gives
        float32[t, n] of patches float32[t, n, p], several for each of t templates in the same space.
        """
        targets, count, pixels = patches.shape
        vectors = embed_rows(templates[0].space, patches.reshape(-1, pixels)).reshape(targets, count, -1)
        known = ([template.anchor for template in templates], [template.mean for template in templates])
        cosines = np.maximum(*(np.einsum("tnk,tk->tn", vectors, np.stack(each)) for each in known))
        return np.asarray(2.0 * (1.0 - cosines), np.float32)


def embed_rows(space: FeatureSpace, patches: Float32Array) -> Float32Array:
    """Unit vectors float32[n, k] of patches float32[n, p], grey levels minus 128."""
    height, width = space.patch_size
    vectors = space.embed((patches + MIDDLE_GREY).reshape(-1, height, width))
    return unit_rows(np.nan_to_num(np.asarray(vectors, np.float32)).reshape(len(patches), -1))


def unit_rows(vectors: Float32Array) -> Float32Array:
    """float32[n, k] rows scaled to length 1; zero rows stay zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-9), np.float32)
