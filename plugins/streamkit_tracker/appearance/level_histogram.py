"""Histograms of the grey levels of a target and its background: a cue that survives changes of posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled, product
from streamkit_tracker.appearance.frame_crops import MIDDLE_GREY, Float32Array
from streamkit_tracker.appearance.gradient_channels import CELL, GRID, SAMPLES

IndexArray = NDArray[np.int32]

BINS = 32
LEARNING_RATE = 0.04
INNER = 0.8  # of a target's sides: the corners of a window are ground
OUTER = 1.1  # of its sides: beyond is ground
FLOOR = 1e-3  # share of a level that neither has; such a level speaks for both
FAMILIAR, STRANGE = 0.85, 0.6  # overlaps of the ground's levels with the usual: trusted, and not at all
TARGET, BETWEEN, GROUND = range(3)
MOST = 1.25


@dataclass(frozen=True, eq=False)
class LevelMap:
    """Share of each shifted window that is the target's by its grey levels.

    Attributes:
        shares: float32[grid, grid], 0 to 1, shifts around a ring as those of a filter response.
        trust: 0 to 1, how far the ground still has the levels it had.
        usual: share at no shift of the patches that were learnt.
    """

    shares: Float32Array
    trust: float
    usual: float

    def relative_share(self, row: int, column: int) -> float:
        """Share of a shift relative to the usual one, at most 1.25; 1 where the levels cannot be trusted."""
        return float(min(float(self.shares[row, column]) / max(self.usual, FLOOR), MOST) ** self.trust)


class LevelHistogram:
    """Histograms of the grey levels of a target and of the ground around it.

    Gradients tell where a target lies, and lose it when it turns or bends; its levels stay. A new light
    changes all levels: then those of the ground are not the usual ones either, and the map is not trusted.

    Source: Bertinetto, Valmadre, Golodetz, Miksik and Torr, Staple: Complementary Learners for Real-Time
    Tracking, CVPR 2016.

    Args:
        patch: float32[samples * samples], grey levels minus 128 of the first region, the target in its
            middle.
        scale: sides of the region along and across, relative to the target's.
    """

    def __init__(self, patch: Float32Array, scale: tuple[float, float]) -> None:
        self._along, self._across = _means(scale[0]).T.copy(), _means(scale[1])
        self._parts = _parts(scale)
        self._samples = np.maximum(np.bincount(self._parts, minlength=3), 1)
        self._levels = self._count(patch)
        self._usual = 1.0
        self._usual = float(self.respond(patch).shares[0, 0])

    def learn(self, patch: Float32Array, rate: float = LEARNING_RATE) -> None:
        """Learns a patch with the target in its middle."""
        counts = self._count(patch)
        self._usual += rate * (float(self._shares(patch)[0, 0]) - self._usual)
        self._levels += np.float32(rate) * (counts - self._levels)

    def respond(self, patch: Float32Array) -> LevelMap:
        """The shares of a patch, float32[samples * samples]."""
        overlap = float(np.sum(np.sqrt(self._count(patch)[GROUND] * self._levels[GROUND])))
        trust = (overlap - STRANGE) / (FAMILIAR - STRANGE)
        return LevelMap(self._shares(patch), min(max(trust, 0.0), 1.0), self._usual)

    def _shares(self, patch: Float32Array) -> Float32Array:
        target, ground = self._levels[TARGET], self._levels[GROUND]
        table = (target + np.float32(FLOOR / 2)) / (target + ground + np.float32(FLOOR))
        cells = np.empty((GRID, GRID), np.float32)
        _look_up(patch, table, cells)
        return product(product(self._across, cells), self._along)

    def _count(self, patch: Float32Array) -> Float32Array:
        """float32[3, bins]: shares of the levels in target, between and ground, each with its neighbours."""
        counts = np.zeros((3, BINS), np.float32)
        _count(patch, self._parts, counts)
        counts /= self._samples[:, None].astype(np.float32)
        smooth = np.float32(0.5) * counts
        smooth[:, 1:] += np.float32(0.25) * counts[:, :-1]
        smooth[:, :-1] += np.float32(0.25) * counts[:, 1:]
        return smooth


def _parts(scale: tuple[float, float]) -> NDArray[np.uint8]:
    """uint8[samples * samples]: what each sample of the region belongs to."""
    from_middle = np.abs((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5)
    along, across = from_middle[None] * scale[0], from_middle[:, None] * scale[1]
    farthest = np.maximum(along, across)
    parts = np.where(farthest < INNER / 2, TARGET, np.where(farthest > OUTER / 2, GROUND, BETWEEN))
    return parts.astype(np.uint8).ravel()


def _means(scale: float) -> Float32Array:
    """float32[grid, grid]: what makes cells along one axis means over the target's side, at every shift."""
    side, shifts = INNER * GRID / scale, np.arange(GRID)
    middles = GRID / 2 + np.where(shifts < GRID // 2, shifts, shifts - GRID)
    cells = np.arange(GRID)
    ends = np.minimum(middles[:, None] + side / 2, cells + 1)
    starts = np.maximum(middles[:, None] - side / 2, cells)
    return np.asarray(np.clip(ends - starts, 0, 1) / side, np.float32)


@compiled
def _find_bins(levels: Float32Array, bins: IndexArray) -> None:
    """Fills in the bin of each grey level; a loop of its own, which vectorises."""
    for sample in range(len(levels)):
        level = (levels[sample] + np.float32(MIDDLE_GREY)) * np.float32(BINS / 256)
        bins[sample] = np.int32(min(max(level, np.float32(0)), np.float32(BINS - 1)))


@compiled
def _count(patch: Float32Array, parts: NDArray[np.uint8], counts: Float32Array) -> None:
    """Adds up how often each part has each level; `counts` float32[3, bins]."""
    bins, flat = np.empty(len(patch), np.int32), counts.reshape(counts.size)
    _find_bins(patch, bins)
    for sample in range(len(patch)):
        flat[np.uint32(np.int32(parts[sample]) * np.int32(BINS) + bins[sample])] += np.float32(1)


@compiled
def _look_up(patch: Float32Array, table: Float32Array, cells: Float32Array) -> None:
    """Means over cells of what a table says of the levels; `cells` float32[grid, grid] is filled."""
    share, bins, total = np.float32(1 / CELL**2), np.empty(SAMPLES, np.int32), np.empty(SAMPLES, np.float32)
    for row in range(GRID):
        total[:] = 0
        for line in range(row * CELL, row * CELL + CELL):
            _find_bins(patch[line * SAMPLES : line * SAMPLES + SAMPLES], bins)
            for sample in range(SAMPLES):
                total[sample] += table[np.uint32(bins[sample])]
        for cell in range(GRID):
            of_three = total[CELL * cell] + total[CELL * cell + 1] + total[CELL * cell + 2]
            cells[row, cell] = of_three * share
