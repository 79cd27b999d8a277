"""Reads a gallery from a folder of pictures: one folder for each label."""

from pathlib import Path

import cv2
import numpy as np

from streamkit_wavelet_eigen.gallery import Gallery

PICTURE_ENDS = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff", ".webp"}
MOST_PICTURES = 4096


def read_gallery(folder: Path, patch: int) -> Gallery:
    """Reads `folder/LABEL/PICTURE`, each picture a window of the target, scaled to `patch` px.

    Args:
        folder: holds one folder for each label; names of folders are the labels.
        patch: side of the windows, px.

    Raises:
        ValueError: there is no picture, one cannot be read, or there are more than 4096.
        OSError: the folder cannot be read.
    """
    paths = [
        path
        for label in sorted(entry for entry in folder.iterdir() if entry.is_dir())
        for path in sorted(label.iterdir())
        if path.suffix.lower() in PICTURE_ENDS
    ]
    if not 0 < len(paths) <= MOST_PICTURES:
        raise ValueError(
            f"{folder}: a gallery has 1 to {MOST_PICTURES} pictures in folders named after their labels, "
            f"got {len(paths)}"
        )
    return Gallery(
        np.stack([_window(path, patch) for path in paths]), tuple(path.parent.name for path in paths)
    )


def _window(path: Path, patch: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    encoded = np.fromfile(path, np.uint8)
    picture = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE) if len(encoded) else None
    if picture is None:
        raise ValueError(f"{path}: not a picture that can be read; remove it or save it as PNG")
    shrink = cv2.INTER_AREA if max(picture.shape) > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, (patch, patch), interpolation=shrink), np.uint8)
