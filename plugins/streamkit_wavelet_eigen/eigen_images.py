"""Images of a feature space: its mean and eigenvectors."""

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, join_blocks

MIDDLE_GREY = 128.0
GAP = 2


def eigen_images(space: WaveletEigenSpace, count: int = 16) -> NDArray[np.uint8]:
    """The mean window, then the leading eigenvectors as images around middle grey.

    Each eigenvector is scaled so that its strongest element is black or white. Blocks with a basis each are
    arranged as in the window; of a shared basis each image is one block.

    Args:
        space: to show.
        count: maximum number of eigenvectors.

    Returns:
        uint8[1 + min(count, rank), h, w].
    """
    shown = min(count, space.rank)
    rows = np.zeros((1 + shown, len(space.spaces), space.recipe.block_values))
    for index, part in enumerate(space.spaces):
        rows[0, index] = part.mean
        rows[1 : 1 + min(shown, part.rank), index] = part.basis[:shown]
    height, width = space.recipe.prepared_size
    blocks = 1 if len(space.spaces) == space.recipe.blocks**2 else space.recipe.blocks
    images = join_blocks(rows, (height // blocks, width // blocks))
    strongest = np.abs(images[1:]).max(axis=(1, 2), keepdims=True)
    scale = np.divide(127.0, strongest, out=np.zeros_like(strongest), where=strongest > 0)
    images[1:] = MIDDLE_GREY + images[1:] * scale
    return np.rint(np.clip(images, 0.0, 255.0)).astype(np.uint8)


def image_grid(images: NDArray[np.uint8], columns: int = 9) -> NDArray[np.uint8]:
    """One image of uint8[n, h, w], `columns` to a row, on white with 2 px between them."""
    count, height, width = images.shape
    columns = max(min(columns, count), 1)
    rows = -(-count // columns)
    grid = np.full((rows * (height + GAP) - GAP, columns * (width + GAP) - GAP), 255, np.uint8)
    for index, image in enumerate(images):
        top, left = index // columns * (height + GAP), index % columns * (width + GAP)
        grid[top : top + height, left : left + width] = image
    return grid
