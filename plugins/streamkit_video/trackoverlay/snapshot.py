"""The file of a snapshot of an overlay, written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit.output.file import write_whole


def check_target(path: Path) -> None:
    """Checks that an image can be written to a path.

    Raises:
        OSError: the folder does not exist, or the suffix is of no image format.
    """
    if not path.parent.is_dir():
        raise OSError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.is_dir():
        raise OSError(f"{path}: is a folder; give the name of an image file")
    if not path.suffix or not cv2.haveImageWriter(str(path)):
        raise OSError(f"{path}: no image format has the ending {path.suffix!r}; take .png or .jpg")


def write_snapshot(path: Path, image: NDArray[np.uint8]) -> None:
    """Writes a BGR image; an existing file is replaced when the new one is complete.

    Raises:
        OSError: it cannot be written.
    """
    try:
        encoded, content = cv2.imencode(path.suffix, image)
    except cv2.error as error:
        raise OSError(f"{path}: {error.err}") from error
    if not encoded:
        raise OSError(f"{path}: the image cannot be encoded as {path.suffix}; take .png or .jpg")
    write_whole(path, content.tobytes())
