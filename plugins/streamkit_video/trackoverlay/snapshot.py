"""Writing one picture to a file, whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def check_target(path: Path) -> None:
    """Checks that a picture can be written to a path.

    Raises:
        OSError: the folder is not there, or the ending is of no picture format.
    """
    if not path.parent.is_dir():
        raise OSError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.is_dir():
        raise OSError(f"{path}: is a folder; give the name of a picture file")
    if not path.suffix or not cv2.haveImageWriter(str(path)):
        raise OSError(f"{path}: no picture format has the ending {path.suffix!r}; take .png or .jpg")


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Writes a BGR picture; a reader sees the old file or the new one, never a part.

    Raises:
        OSError: it cannot be written.
    """
    encoded, content = cv2.imencode(path.suffix, picture)
    if not encoded:
        raise OSError(f"{path}: the picture cannot be encoded as {path.suffix}; take .png or .jpg")
    handle, draft = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.tobytes())
        # A draft is private; the picture gets the rights of any new file.
        umask = os.umask(0)
        os.umask(umask)
        Path(draft).chmod(0o666 & ~umask)
        Path(draft).replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            Path(draft).unlink()
        raise
