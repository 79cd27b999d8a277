"""Everything that decides how a feature space is made, and the presets that were measured."""

from dataclasses import dataclass, field
from enum import StrEnum

from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing


class Basis(StrEnum):
    """Whose eigenvectors a block is projected on."""

    SHARED = "shared"
    PER_BLOCK = "per-block"


class Views(StrEnum):
    """Virtual views of each labelled window that are learnt beside it."""

    NONE = "none"
    SHIFTED = "shifted"
    MIRRORED = "mirrored"


class Metric(StrEnum):
    """How far two feature vectors are from each other."""

    EUCLIDEAN = "euclidean"
    SUMMED = "summed"
    COSINE = "cosine"


@dataclass(frozen=True)
class Recipe:
    """How windows become feature vectors.

    Attributes:
        patch: side of the windows, px.
        preprocessing: what is done to a window first.
        blocks: blocks per side into which the prepared window is cut; 1 takes it whole.
        basis: one basis for all blocks (modular PCA) or one each (sub-pattern PCA).
        components: most eigenvectors, for each block.
        energy: share of the variance to hold with as few of them as can be; 1 keeps `components`.
        discriminative: whether a Fisher step follows, which needs labels.
        shrinkage: share of the within-class scatter replaced by an even one in the Fisher step, 0 to 1.
        views: virtual views of labelled windows that are learnt, and put into the gallery, beside them.
        metric: how vectors are compared: Euclidean; the sum of the blocks' Euclidean distances; 1 - cosine.
    """

    patch: int = 32
    preprocessing: Preprocessing = field(default_factory=Preprocessing)
    blocks: int = 1
    basis: Basis = Basis.SHARED
    components: int = 16
    energy: float = 1.0
    discriminative: bool = False
    shrinkage: float = 0.1
    views: Views = Views.NONE
    metric: Metric = Metric.EUCLIDEAN

    @property
    def patch_size(self) -> tuple[int, int]:
        """(height, width) of the windows."""
        return self.patch, self.patch

    @property
    def prepared_size(self) -> tuple[int, int]:
        """(height, width) of the prepared windows."""
        return self.preprocessing.prepared_size(self.patch_size)

    @property
    def block_values(self) -> int:
        """Values of one block of a prepared window."""
        height, width = self.prepared_size
        return (height // self.blocks) * (width // self.blocks)

    @property
    def spaces(self) -> int:
        """How many eigenspaces there are."""
        return self.blocks**2 if self.basis is Basis.PER_BLOCK else 1

    def check(self) -> None:
        """Refuses what does not fit together.

        Raises:
            ValueError: says which rule is broken.
        """
        self.preprocessing.check(self.patch_size)
        side = self.prepared_size[0]
        if self.blocks < 1 or side % self.blocks:
            raise ValueError(
                f"recipe: the prepared side, {side} px, must be a multiple of blocks, got {self.blocks}; "
                "use 1, 2 or 4"
            )
        if not 1 <= self.components <= self.block_values:
            raise ValueError(
                f"recipe: components must be 1 to {self.block_values}, the values of a block, "
                f"got {self.components}"
            )
        if not 0.0 < self.energy <= 1.0 or not 0.0 <= self.shrinkage <= 1.0:
            raise ValueError(
                f"recipe: energy must be above 0 and at most 1, and shrinkage 0 to 1, "
                f"got {self.energy} and {self.shrinkage}"
            )


_RAW = Preprocessing(Mode.RAW)

# Measured by `streamkit experiments`; docs/paper-tables.md has the figures.
PRESETS: dict[str, Recipe] = {
    # The published chain: db8, both equalisations, 16 blocks, nearest neighbour by summed block distances.
    "paper": Recipe(patch=64, blocks=4, components=10, metric=Metric.SUMMED),
    # The same blocks without the preparation, which recognises better.
    "modular": Recipe(patch=64, preprocessing=_RAW, blocks=4, components=10, metric=Metric.SUMMED),
    # What splits of the training pictures alone chose: two low-pass levels of db8, virtual views, Fisher.
    "recognition": Recipe(
        patch=64,
        preprocessing=Preprocessing(Mode.RAW, approximation=2),
        components=60,
        discriminative=True,
        views=Views.MIRRORED,
    ),
}
