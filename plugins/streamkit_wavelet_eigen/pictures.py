"""Pictures of a space: its mean and eigen-images, side by side."""

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.blocks import join_blocks
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace

MIDDLE_GREY = 128.0
GAP = 2


def eigen_images(space: WaveletEigenSpace, count: int = 16) -> NDArray[np.uint8]:
    """The mean window, then the leading eigenvectors as pictures.

    An eigenvector is shown around middle grey, scaled so that its strongest element is black or white. Blocks
    with a basis each stand where they lie in the window; of a shared basis each picture is one block.

    Args:
        space: what to show.
        count: most eigenvectors.

    Returns:
        uint8[1 + min(count, rank), h, w].
    """
    shown = min(count, space.rank)
    rows = np.zeros((1 + shown, len(space.spaces), space.recipe.block_values))
    for index, part in enumerate(space.spaces):
        rows[0, index] = part.mean
        rows[1 : 1 + min(shown, part.rank), index] = part.basis[:shown]
    height, width = space.recipe.prepared_size
    whole = len(space.spaces) == space.recipe.blocks**2
    blocks = 1 if whole else space.recipe.blocks
    pictures = join_blocks(rows, (height // blocks, width // blocks))
    strongest = np.abs(pictures[1:]).max(axis=(1, 2), keepdims=True)
    scaled = np.divide(127.0, strongest, out=np.zeros_like(strongest), where=strongest > 0)
    pictures[1:] = MIDDLE_GREY + pictures[1:] * scaled
    return np.rint(np.clip(pictures, 0.0, 255.0)).astype(np.uint8)


def side_by_side(pictures: NDArray[np.uint8], columns: int = 9) -> NDArray[np.uint8]:
    """One picture of uint8[n, h, w], `columns` to a row, on white with 2 px between them."""
    count, height, width = pictures.shape
    columns = max(min(columns, count), 1)
    rows = -(-count // columns)
    sheet = np.full((rows * (height + GAP) - GAP, columns * (width + GAP) - GAP), 255, np.uint8)
    for index, picture in enumerate(pictures):
        top, left = index // columns * (height + GAP), index % columns * (width + GAP)
        sheet[top : top + height, left : left + width] = picture
    return sheet
