"""GeoTIFF files of mosaics, in their UTM zone."""

import math
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, inverse, normalised, project
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.georeference import Georeference
from streamkit_stitcher.mosaic.tiles import ImageArray

_MODEL_PIXEL_SCALE: Final = 33550
_MODEL_TIE_POINT: Final = 33922
_MODEL_TRANSFORMATION: Final = 34264
_GEO_KEY_DIRECTORY: Final = 34735
_GDAL_NODATA: Final = 42113
_PROJECTED, _PIXEL_IS_AREA, _METRE = 1, 1, 9001
_BIG_BYTES: Final = 4_000_000_000
# Relative to the scale: moves no pixel of the largest mosaic by a tenth of one.
_NO_ROTATION: Final = 1e-6


def check_geotiff(location: str) -> None:
    """Checks that the libraries for GeoTIFF are installed.

    Raises:
        OSError: tifffile or pyproj is missing.
    """
    try:
        import pyproj  # noqa: F401
        import tifffile  # noqa: F401
    except ImportError as error:
        raise OSError(
            f"location={location}: a GeoTIFF needs {error.name}; install streamkit with its extra: "
            "pip install 'streamkit[geo]'"
        ) from error


def utm_code(place: GeodeticPoint) -> int:
    """The EPSG code of a position's UTM zone, WGS84."""
    zone = min(60, int((place.longitude + 180) // 6) + 1)
    return (32600 if place.latitude >= 0 else 32700) + zone


def to_utm(geo: Georeference) -> tuple[FloatArray, int]:
    """float64[3, 3] from mosaic pixels to metres of the UTM zone, and the zone's EPSG code."""
    import pyproj

    code = utm_code(geo.origin)
    zone, place = pyproj.Proj(code), (geo.origin.longitude, geo.origin.latitude)
    (east, north), factors = zone(*place), zone.get_factors(*place)
    scale, angle = factors.meridional_scale, -math.radians(factors.meridian_convergence)
    cos, sin = scale * math.cos(angle), scale * math.sin(angle)
    return np.array([[cos, sin, east], [-sin, cos, north], [0, 0, 1.0]]) @ geo.to_local, code


def north_up(geo: Georeference) -> FloatArray:
    """The change of a mosaic, float64[3, 3], that puts grid north up and takes out perspective.

    Most programs resample a rotated GeoTIFF, and some cannot show it. A pixel's area stays at the origin.
    """
    matrix, _ = to_utm(geo)
    east, north = project(matrix @ inverse(geo.to_local), np.zeros((1, 2)))[0]
    moved = normalised(np.array([[1, 0, -east], [0, -1, north], [0, 0, 1.0]]) @ matrix)
    middle = project(inverse(geo.to_local), np.zeros((1, 2)))[0]
    depth = float(moved[2, :2] @ middle + moved[2, 2])
    metres = math.sqrt(abs(float(np.linalg.det(moved)) / depth**3))
    return normalised(np.diag([1 / metres, 1 / metres, 1.0]) @ moved)


def write_geotiff(image: ImageArray, path: Path, geo: Georeference | None) -> None:
    """Writes a tiled TIFF, georeferenced if possible; 0 is declared as no data.

    Raises:
        OSError: the file cannot be written.

    Source: OGC GeoTIFF standard 1.1, 19-008r4: tags 33550, 33922, 34264 and 34735; tag 42113 of GDAL.
    """
    import tifffile

    colours = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    tifffile.imwrite(
        path,
        colours,
        photometric="minisblack" if image.ndim == 2 else "rgb",
        tile=(256, 256),
        compression="zlib",
        bigtiff=colours.nbytes > _BIG_BYTES,
        metadata=None,
        extratags=[(_GDAL_NODATA, "s", 0, "0", True), *([] if geo is None else _tags(geo))],
    )


def _tags(geo: Georeference) -> list[tuple[int, str, int, Any, bool]]:
    matrix, code = to_utm(geo)
    # Raster space starts at the corner of the first pixel, not at its centre.
    half = matrix @ np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
    keys = (
        1, 1, 0, 4,
        1024, 0, 1, _PROJECTED,
        1025, 0, 1, _PIXEL_IS_AREA,
        3072, 0, 1, code,
        3076, 0, 1, _METRE,
    )  # fmt: skip
    return [*_transformation_tags(half), (_GEO_KEY_DIRECTORY, "H", len(keys), keys, True)]


def _transformation_tags(matrix: FloatArray) -> list[tuple[int, str, int, Any, bool]]:
    """The tags of float64[3, 3], raster space to the zone: scale and tie point, or the whole matrix."""
    linear = matrix[:2, :2]
    east, north = (float(value) for value in matrix[:2, 2])
    if max(abs(linear[0, 1]), abs(linear[1, 0])) < _NO_ROTATION * abs(linear[0, 0]):
        scale = float(linear[0, 0]), float(-linear[1, 1]), 0.0
        tie_point = 0.0, 0.0, 0.0, east, north, 0.0
        return [(_MODEL_PIXEL_SCALE, "d", 3, scale, True), (_MODEL_TIE_POINT, "d", 6, tie_point, True)]
    (a, b), (d, e) = linear.tolist()
    rows = (a, b, 0.0, east, d, e, 0.0, north, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return [(_MODEL_TRANSFORMATION, "d", 16, rows, True)]
