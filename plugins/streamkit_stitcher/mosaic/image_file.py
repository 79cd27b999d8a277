"""Image files of mosaics."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

import cv2

from streamkit.output.file import check_writable
from streamkit_stitcher.mosaic.georeference import Georeference
from streamkit_stitcher.mosaic.geotiff import check_geotiff, write_geotiff
from streamkit_stitcher.mosaic.tiles import ImageArray

TIFF_SUFFIXES: Final = (".tif", ".tiff")
SUFFIXES: Final = (".png", ".jpg", ".jpeg", *TIFF_SUFFIXES)
_JPEG_QUALITY: Final = 92
_MAX_JPEG_SIDE: Final = 65500


def check_location(location: str) -> None:
    """Checks the path of an image, with `%d` for a file per plane, before the flight.

    Raises:
        OSError: the suffix is unknown, the number format is wrong, or the file cannot be made.
    """
    path = location_of(location, 0)
    if path.suffix.lower() not in SUFFIXES:
        raise OSError(
            f"location must end in {', '.join(SUFFIXES)}, got {location!r}; write location=mosaic.png"
        )
    if is_tiff(location):
        check_geotiff(location)
    try:
        check_writable(path)
    except OSError as error:
        raise OSError(
            f"location={location} cannot be written: {error.strerror}; name another file"
        ) from error


def location_of(location: str, reference: int) -> Path:
    """The file of one plane: `location` with its `%d` (or `%03d`) replaced by the number of the plane.

    Raises:
        OSError: `%` is not followed by an integer format.
    """
    if "%" not in location:
        return Path(location)
    for values in (reference, ()):
        try:
            return Path(location % values)
        except (TypeError, ValueError):
            continue
    raise OSError(
        f"location={location}: `%` must be one number such as %d or %03d; write %% for a percent sign"
    )


def is_numbered(location: str) -> bool:
    """Whether `location` names another file for each plane."""
    return location_of(location, 0) != location_of(location, 1)


def is_tiff(location: str) -> bool:
    """Whether `location` names a TIFF, which can be georeferenced."""
    return Path(location).suffix.lower() in TIFF_SUFFIXES


def write_image(image: ImageArray, path: Path, geo: Georeference | None = None) -> None:
    """Writes an image atomically, in the format of the suffix; a TIFF is georeferenced. Folders are made.

    Raises:
        OSError: the image is too large for the format, or the file cannot be written.
    """
    # OpenCV encodes to a path that ends in the format's suffix, without a copy of the file in memory.
    partial = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        if is_tiff(path.name):
            write_geotiff(image, partial, geo)
        else:
            _encode(image, path, partial)
        partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _encode(image: ImageArray, path: Path, partial: Path) -> None:
    """Writes PNG or JPEG row by row, so that a memory-mapped image stays on disk."""
    is_jpeg = path.suffix.lower() != ".png"
    if is_jpeg and max(image.shape[:2]) > _MAX_JPEG_SIDE:
        height, width = image.shape[:2]
        raise OSError(
            f"{path}: a JPEG side is at most {_MAX_JPEG_SIDE} px, got {width} x {height}; write a .png"
        )
    # PNG's default here is run-length encoding: twice as fast as the lowest compression level.
    options = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if is_jpeg else []
    if not cv2.imwrite(str(partial), image, options):
        raise OSError(
            f"{path}: the image could not be written; see whether {path.parent} is there and has room"
        )
