"""The base map of the geographic map: a GeoTIFF as one image with its corners, or a PMTiles archive."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from streamkit.errors import needs_extra

PMTILES_MAGIC = b"PMTiles\x03"
TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PIXEL_LIMIT = 200_000_000
SIDE_PX = 4096  # every WebGL has textures of this size
WGS84 = 4326


class InvalidBasemap(ValueError):
    """A file that cannot be a base map; the message says why, and what to do."""


@dataclass(frozen=True)
class Basemap:
    """What a page needs to show a base map.

    Attributes:
        content: the image to send, or the path of the archive.
        media_type: of the content.
        corners: longitude and latitude, deg, of the image's corners clockwise from the upper left; none of an
            archive.
    """

    content: bytes | Path
    media_type: str
    corners: tuple[tuple[float, float], ...] = ()


def read_basemap(path: Path) -> Basemap:
    """Reads a base map.

    Args:
        path: a GeoTIFF of 8 bits per channel, or a PMTiles archive, version 3.

    Raises:
        InvalidBasemap: the file is neither, or its place on the earth is unknown.
        ResourceError: a library for GeoTIFF is not installed.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(8)
    except OSError as error:
        raise InvalidBasemap(f"{path}: {error.strerror}") from None
    if magic == PMTILES_MAGIC:
        return Basemap(path, "application/vnd.pmtiles")
    if magic[:4] not in TIFF_MAGICS:
        raise InvalidBasemap(f"{path}: a base map must be a GeoTIFF or a PMTiles archive, version 3")
    corners = _corners(path)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8:
        raise InvalidBasemap(
            f"{path}: a base map must have 8 bits per channel; gdal_translate -ot Byte makes one"
        )
    shrink = min(1.0, SIDE_PX / max(image.shape[:2]))
    if shrink < 1:
        image = cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    has_alpha = image.ndim == 3 and image.shape[2] == 4
    _, data = cv2.imencode(".png" if has_alpha else ".jpg", image)
    return Basemap(bytes(data), "image/png" if has_alpha else "image/jpeg", corners)


def _corners(path: Path) -> tuple[tuple[float, float], ...]:
    """Longitude and latitude of the four corners.

    Source: OGC GeoTIFF standard 1.1, 19-008r4, sections 7.1 and B.6.
    """
    with needs_extra(f"{path}: a GeoTIFF", "geo"):
        import pyproj
        import tifffile
    try:
        with tifffile.TiffFile(path) as tiff:
            page = tiff.pages.first
            width, height, tags = page.imagewidth, page.imagelength, tiff.geotiff_metadata or {}
        if width * height > PIXEL_LIMIT:
            raise InvalidBasemap(
                f"{path}: a GeoTIFF has at most {PIXEL_LIMIT} px, got {width}x{height}; "
                "make a PMTiles archive of it"
            )
        code = int(tags.get("ProjectedCSTypeGeoKey") or tags.get("GeographicTypeGeoKey") or 0)
        to_wgs84 = pyproj.Transformer.from_crs(code, WGS84, always_xy=True)
        on_grid = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) @ _grid(tags).T
        longitudes, latitudes = to_wgs84.transform(on_grid[:, 0], on_grid[:, 1], errcheck=True)
    except (KeyError, TypeError, IndexError, tifffile.TiffFileError, pyproj.exceptions.ProjError) as error:
        raise InvalidBasemap(
            f"{path}: its place on the earth is unknown ({error}); gdalwarp -t_srs EPSG:4326 writes it in "
            "full"
        ) from None
    return tuple(zip(longitudes.tolist(), latitudes.tolist(), strict=True))


def _grid(tags: dict[str, Any]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """float64[2, 3] from raster space, whose origin is the first pixel's outer corner, to the grid."""
    if "ModelTransformation" in tags:
        matrix = np.array(tags["ModelTransformation"], dtype=np.float64).reshape(4, 4)[:2, [0, 1, 3]]
    else:
        column, row, _, x, y, _ = np.array(tags["ModelTiepoint"], dtype=np.float64).ravel()[:6]
        across, down = tags["ModelPixelScale"][:2]
        matrix = np.array([[across, 0, x - across * column], [0, -down, y + down * row]])
    if tags.get("GTRasterTypeGeoKey") == 2:  # PixelIsPoint: the origin is the first pixel's centre
        matrix[:, 2] -= matrix[:, :2] @ [0.5, 0.5]
    return matrix
