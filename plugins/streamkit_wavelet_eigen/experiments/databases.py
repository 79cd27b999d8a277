"""Reads the two image databases of the publication from a folder."""

import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.gallery import read_window

VARIABLE = "STREAMKIT_DATA"
SIDE = 64


class MissingData(FileNotFoundError):
    """The databases are missing or incomplete."""


def data_folder(given: Path | None = None) -> Path:
    """The folder with `orl/` and `coil20/`: the given one or STREAMKIT_DATA, or `data` in it.

    Raises:
        MissingData: neither has them.
    """
    place = given or (Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None)
    if place is None:
        raise MissingData(f"experiments need the databases: name their folder with --data or set {VARIABLE}")
    for folder in (place, place / "data"):
        if (folder / "orl").is_dir() and (folder / "coil20").is_dir():
            return folder
    raise MissingData(
        f"{place}: there must be folders orl (sN/M.pgm) and coil20 (objN__K.png) in it; neither database may "
        "be shipped with this program, see docs/paper-tables.md for their origin"
    )


def read_orl(folder: Path) -> NDArray[np.uint8]:
    """The ORL faces, uint8[40, 10, 64, 64]: 40 people, 10 images each, scaled from 92x112 by area."""
    names = [[f"orl/s{person}/{view}.pgm" for view in range(1, 11)] for person in range(1, 41)]
    return _read(folder, names)


def read_coil20(folder: Path) -> NDArray[np.uint8]:
    """COIL-20, uint8[20, 24, 64, 64]: 20 objects, views 15 degrees apart, scaled from 128x128 by area."""
    found: dict[int, list[tuple[int, str]]] = {}
    for path in (folder / "coil20").iterdir():
        if match := re.fullmatch(r"obj(\d+)__(\d+)\.png", path.name):
            found.setdefault(int(match[1]), []).append((int(match[2]), f"coil20/{path.name}"))
    names = [[name for _, name in sorted(found[target])] for target in sorted(found)]
    if len(names) != 20 or any(len(views) != 24 for views in names):
        raise MissingData(f"{folder / 'coil20'}: there must be 20 objects with 24 views each, objN__K.png")
    return _read(folder, names)


def _read(folder: Path, names: list[list[str]]) -> NDArray[np.uint8]:
    images = []
    for name in (name for views in names for name in views):
        try:
            images.append(read_window(folder / name, SIDE))
        except (OSError, ValueError):
            raise MissingData(
                f"{folder / name}: the database is not whole; this image cannot be read"
            ) from None
    return np.stack(images).reshape(len(names), -1, SIDE, SIDE)
