"""Reads a gallery from a folder with one subfolder of images per label."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.gallery import Gallery

IMAGE_SUFFIXES = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff", ".webp"}
MAX_IMAGES = 4096


def read_gallery(folder: Path, patch: int) -> Gallery:
    """Reads `folder/LABEL/IMAGE`; each image is a window, scaled to `patch` px.

    Raises:
        ValueError: there is no image, one cannot be read, or there are more than 4096.
        OSError: the folder cannot be read.
    """
    paths = [
        path
        for label in sorted(entry for entry in folder.iterdir() if entry.is_dir())
        for path in sorted(label.iterdir())
        if path.suffix.lower() in IMAGE_SUFFIXES
    ]
    if not 0 < len(paths) <= MAX_IMAGES:
        raise ValueError(
            f"{folder}: a gallery has 1 to {MAX_IMAGES} pictures in folders named after their labels, "
            f"got {len(paths)}"
        )
    return Gallery(
        np.stack([_read_window(path, patch) for path in paths]), tuple(path.parent.name for path in paths)
    )


def _read_window(path: Path, patch: int) -> NDArray[np.uint8]:
    encoded = np.fromfile(path, np.uint8)
    image = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE) if len(encoded) else None
    if image is None:
        raise ValueError(f"{path}: not a picture that can be read; remove it or save it as PNG")
    interpolation = cv2.INTER_AREA if max(image.shape) > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (patch, patch), interpolation=interpolation), np.uint8)
