"""The settings that decide how a feature space is made, and the measured presets."""

from dataclasses import dataclass, field
from enum import StrEnum

from streamkit.settings import setting
from streamkit_wavelet_eigen.wavelet import transform_matrix


class Mode(StrEnum):
    """Preprocessing steps that are applied to a window."""

    PAPER = "paper"
    DENOISE = "denoise"
    RAW = "raw"


class Threshold(StrEnum):
    """Rule for the soft threshold of the detail sub-bands."""

    VISU = "visu"
    BAYES = "bayes"
    NONE = "none"


@dataclass(frozen=True)
class Preprocessing:
    """Preprocessing of a window before projection."""

    mode: Mode = setting(
        Mode.PAPER, doc="paper: all five published steps; denoise: without equalisation; raw: none of them."
    )
    threshold: Threshold = setting(Threshold.VISU, doc="Rule for the threshold of the wavelet details.")
    wavelet: str = setting("db8", doc="Wavelet, by its PyWavelets name.")
    approximation: int = setting(
        0, min=0, max=5, doc="Low-pass levels after these steps; each halves the sides."
    )

    def check(self, patch_size: tuple[int, int]) -> None:
        """Raises ValueError when patches of this (height, width) cannot be prepared this way."""
        if self.approximation < 0:
            raise ValueError(f"preprocessing: approximation must be at least 0, got {self.approximation}")
        for side in patch_size:
            if self.mode is not Mode.RAW or self.approximation:
                transform_matrix(self.wavelet, side)
            for level in range(1, self.approximation):
                transform_matrix(self.wavelet, side >> level if side % (1 << level) == 0 else 1)

    def prepared_size(self, patch_size: tuple[int, int]) -> tuple[int, int]:
        """(height, width) of a prepared window of (height, width) `patch_size`."""
        height, width = patch_size
        return height >> self.approximation, width >> self.approximation


class Basis(StrEnum):
    """Eigenvectors that a block is projected on: shared is modular PCA, per-block sub-pattern PCA."""

    SHARED = "shared"
    PER_BLOCK = "per-block"


class Views(StrEnum):
    """Virtual views that are learnt with each labelled window."""

    NONE = "none"
    SHIFTED = "shifted"
    MIRRORED = "mirrored"


class Metric(StrEnum):
    """Distance between feature vectors: Euclidean, sum of the blocks' Euclidean distances, 1 - cosine."""

    EUCLIDEAN = "euclidean"
    SUMMED = "summed"
    COSINE = "cosine"


@dataclass(frozen=True)
class Recipe:
    """How windows become feature vectors.

    Attributes:
        shrinkage: share of the within-class scatter replaced by an isotropic one (Fisher step), 0 to 1.
    """

    patch: int = setting(32, min=8, max=128, unit="px", doc="Side of the prepared windows; even.")
    preprocessing: Preprocessing = field(default_factory=Preprocessing)
    blocks: int = setting(1, min=1, max=16, doc="Blocks per side, each projected on its own; 1 is the whole.")
    basis: Basis = setting(Basis.SHARED, doc="One basis for all blocks, or one per block.")
    components: int = setting(16, min=1, max=256, doc="Maximum number of eigenvectors per block.")
    energy: float = setting(
        1.0, min=0.01, max=1.0, doc="Share of variance to keep with the fewest eigenvectors; 1 keeps all."
    )
    discriminative: bool = setting(
        False, doc="Adds a Fisher step on the labels of `gallery`; the space is then fixed."
    )
    shrinkage: float = 0.1
    views: Views = setting(Views.NONE, doc="Virtual views learnt with each labelled window.")
    metric: Metric = setting(Metric.EUCLIDEAN, doc="Distance between vectors; summed adds up blocks.")

    @property
    def patch_size(self) -> tuple[int, int]:
        """(height, width) of the windows, px."""
        return self.patch, self.patch

    @property
    def prepared_size(self) -> tuple[int, int]:
        """(height, width) of the prepared windows, px."""
        return self.preprocessing.prepared_size(self.patch_size)

    @property
    def block_values(self) -> int:
        """Number of values in a block of a prepared window."""
        height, width = self.prepared_size
        return (height // self.blocks) * (width // self.blocks)

    @property
    def spaces(self) -> int:
        """Number of eigenspaces."""
        return self.blocks**2 if self.basis is Basis.PER_BLOCK else 1

    def check(self) -> None:
        """Raises ValueError, with the rule that is broken, when the settings do not fit together."""
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

# Measured by `streamkit experiments`; docs/paper-tables.md has the results.
PRESETS: dict[str, Recipe] = {
    # The published method: db8, both equalisations, 16 blocks, nearest neighbour by summed block distances.
    "paper": Recipe(patch=64, blocks=4, components=10, metric=Metric.SUMMED),
    # The same blocks without preprocessing; its recognition rate is higher.
    "modular": Recipe(patch=64, preprocessing=_RAW, blocks=4, components=10, metric=Metric.SUMMED),
    # Selected on training images alone: two low-pass levels of db8, virtual views, Fisher step.
    "recognition": Recipe(
        patch=64,
        preprocessing=Preprocessing(Mode.RAW, approximation=2),
        components=60,
        discriminative=True,
        views=Views.MIRRORED,
    ),
}
