"""A base map lies where its file says, and other files are refused with what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyproj
import pytest
import tifffile

from streamkit_view import basemap as module
from streamkit_view.basemap import InvalidBasemap, read_basemap

SCALE, TIE_POINT, TRANSFORMATION, KEYS = 33550, 33922, 34264, 34735
UTM_32N = 32632
EAST, NORTH = 500_000.0, 5_200_000.0


def write_tiff(
    path: Path, image: np.ndarray[Any, Any], code: int, *tags: Any, is_point: bool = False
) -> None:
    """A GeoTIFF in the grid of an EPSG code."""
    kind, key = (2, 2048) if code == module.WGS84 else (1, 3072)
    keys = (1, 1, 0, 3, 1024, 0, 1, kind, 1025, 0, 1, 2 if is_point else 1, key, 0, 1, code)
    extra = [
        *((tag, "d", len(values), values, True) for tag, values in tags),
        (KEYS, "H", len(keys), keys, True),
    ]
    photometric = "minisblack" if image.ndim == 2 else "rgb"
    tifffile.imwrite(path, image, photometric=photometric, metadata=None, extratags=extra)


def in_utm(corners: tuple[tuple[float, float], ...]) -> np.ndarray[Any, Any]:
    """East and north of the corners, m."""
    grid = pyproj.Transformer.from_crs(4326, UTM_32N, always_xy=True)
    return np.column_stack(grid.transform(*np.array(corners).T))


@pytest.mark.parametrize("is_point", [False, True])
def test_an_image_lies_where_scale_and_tie_point_say(tmp_path: Path, is_point: bool) -> None:
    """200 x 100 m, north up; a tie point at a pixel's centre is half a pixel further in."""
    path = tmp_path / "a.tif"
    tags = [(SCALE, (0.5, 0.5, 0.0)), (TIE_POINT, (0.0, 0.0, 0.0, EAST, NORTH, 0.0))]
    write_tiff(path, np.full((200, 400, 3), 90, np.uint8), UTM_32N, *tags, is_point=is_point)
    found = read_basemap(path)
    half = 0.25 if is_point else 0.0
    west, top = EAST - half, NORTH + half
    expected = [(west, top), (west + 200, top), (west + 200, top - 100), (west, top - 100)]
    np.testing.assert_allclose(in_utm(found.corners), expected, atol=1e-3)
    assert isinstance(found.content, bytes)
    assert cv2.imdecode(np.frombuffer(found.content, np.uint8), cv2.IMREAD_UNCHANGED).shape == (200, 400, 3)


def test_a_turned_image_lies_where_its_matrix_says(tmp_path: Path) -> None:
    """Columns run north, rows east; transparency is kept."""
    path = tmp_path / "a.tif"
    rows = (0.0, 2.0, 0.0, EAST, 2.0, 0.0, 0.0, NORTH, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    write_tiff(path, np.full((10, 20, 4), 90, np.uint8), UTM_32N, (TRANSFORMATION, rows))
    found = read_basemap(path)
    expected = [(EAST, NORTH), (EAST, NORTH + 40), (EAST + 20, NORTH + 40), (EAST + 20, NORTH)]
    np.testing.assert_allclose(in_utm(found.corners), expected, atol=1e-3)
    assert found.media_type == "image/png"


def test_a_large_image_is_shrunk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the largest texture that every browser has."""
    monkeypatch.setattr(module, "SIDE_PX", 50)
    path = tmp_path / "a.tif"
    tags = [(SCALE, (1e-5, 1e-5, 0.0)), (TIE_POINT, (0.0, 0.0, 0.0, 8.0, 47.0, 0.0))]
    write_tiff(path, np.zeros((100, 200), np.uint8), module.WGS84, *tags)
    found = read_basemap(path)
    assert isinstance(found.content, bytes)
    assert cv2.imdecode(np.frombuffer(found.content, np.uint8), cv2.IMREAD_UNCHANGED).shape == (25, 50)
    assert found.corners[2] == pytest.approx((8.002, 46.999))


def plain_tiff(path: Path) -> None:
    """No tags of a place."""
    tifffile.imwrite(path, np.zeros((10, 10), np.uint8))


def unknown_grid(path: Path) -> None:
    """An EPSG code that does not exist."""
    tags = [(SCALE, (1.0, 1.0, 0.0)), (TIE_POINT, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))]
    write_tiff(path, np.zeros((10, 10), np.uint8), 32767, *tags)


def deep_tiff(path: Path) -> None:
    """16 bits per channel."""
    tags = [(SCALE, (1e-5, 1e-5, 0.0)), (TIE_POINT, (0.0, 0.0, 0.0, 8.0, 47.0, 0.0))]
    write_tiff(path, np.zeros((10, 10), np.uint16), module.WGS84, *tags)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (plain_tiff, "place on the earth is unknown"),
        (unknown_grid, "place on the earth is unknown"),
        (deep_tiff, "8 bits per channel"),
        (lambda path: path.write_bytes(b"II*\0" + b"\xff" * 40), "place on the earth is unknown"),
        (lambda path: path.write_bytes(b"PMTiles\x02" + bytes(200)), "version 3"),
        (lambda path: path.write_bytes(b""), "GeoTIFF or a PMTiles"),
        (lambda path: None, "No such file"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, write: Callable[[Path], object], message: str) -> None:
    """The error names the file."""
    path = tmp_path / "base.tif"
    write(path)
    with pytest.raises(InvalidBasemap, match=rf"{path}: .*{message}"):
        read_basemap(path)
