"""Reads the ground image."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def load_ground(location: str | None) -> NDArray[np.uint8]:
    """Reads the image that the camera flies over.

    Args:
        location: path of an image; None for the aerial photograph shipped with the plugin.

    Returns:
        uint8[h, w, 3], BGR.

    Raises:
        OSError: the file does not exist or is no image.
    """
    if location is not None:
        return _read(Path(location))
    with as_file(files("streamkit_video") / "data" / "aerial.jpg") as shipped:
        return _read(shipped)


def _read(path: Path) -> NDArray[np.uint8]:
    content = np.frombuffer(path.read_bytes(), np.uint8)
    try:
        image = cv2.imdecode(content, cv2.IMREAD_COLOR_BGR) if content.size else None
    except cv2.error as error:
        raise OSError(
            f"{path}: cannot be read as a picture ({error.err}); give a JPEG or PNG file"
        ) from error
    if image is None:
        raise OSError(f"{path}: is no picture that OpenCV reads; give a JPEG or PNG file")
    return np.asarray(image, np.uint8)
