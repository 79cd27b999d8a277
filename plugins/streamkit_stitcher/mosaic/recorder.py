"""Which pictures go into a mosaic, and when a mosaic is written."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from streamkit_stitcher.mosaic.canvas import PictureArray
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.picture_file import is_numbered, location_of, write_picture
from streamkit_stitcher.plane.tracker import Placement

_WORTH_ADDING: Final = 0.08


@dataclass(frozen=True)
class WrittenMosaic:
    """A mosaic that was written.

    Attributes:
        path: the file.
        reference: number of its plane.
        width: px.
        height: px.
        scale: its pixels per px of the plane.
        pictures: number of pictures in it.
    """

    path: Path
    reference: int
    width: int
    height: int
    scale: float
    pictures: int


class MosaicRecorder:
    """Keeps the mosaic of the current plane and writes those that are finished.

    Key pictures go in, and pictures that show ground not seen before; a picture whose place was not measured
    never does. With `%d` in the location each plane gets a file; otherwise the one that covers most is kept.

    Args:
        location: path of the mosaic, see `mosaic_file.check_location`.
        max_px: most pixels of a mosaic.
    """

    def __init__(self, location: str, max_px: int) -> None:
        self._location = location
        self._max_px = max_px
        self._mosaic = Mosaic(max_px)
        self._reference = 0
        self._largest = 0.0
        self._refused = 0

    @property
    def refused(self) -> int:
        """Pictures that no mosaic could take, being out of reach or degenerate."""
        return self._refused

    def add(
        self, placement: Placement, shape: tuple[int, int], picture: Callable[[], PictureArray]
    ) -> WrittenMosaic | None:
        """Takes a placed picture where it is worth it.

        Args:
            placement: where it lies.
            shape: (height, width), px.
            picture: gives uint8[h, w] or uint8[h, w, 3] BGR; called only when the picture goes in.

        Returns:
            The mosaic of the plane before, where this picture opened a new one.

        Raises:
            OSError: that mosaic could not be written.
        """
        finished = self._mosaic, self._reference
        changed = placement.reference != self._reference
        if changed:
            self._mosaic, self._reference = Mosaic(self._max_px), placement.reference
        if placement.anchored and (placement.keyframe or self._is_new_ground(shape, placement)):
            added = self._mosaic.add(picture(), placement.to_reference, fills_gaps=not placement.keyframe)
            self._refused += not added
        return self._write(*finished) if changed else None

    def _is_new_ground(self, shape: tuple[int, int], placement: Placement) -> bool:
        return self._mosaic.uncovered(shape, placement.to_reference) > _WORTH_ADDING

    def finish(self) -> WrittenMosaic | None:
        """Writes the current mosaic, once; None where there is none or a larger one was written before.

        Raises:
            OSError: it could not be written.
        """
        finished, self._mosaic = self._mosaic, Mosaic(self._max_px)
        return self._write(finished, self._reference)

    def _write(self, mosaic: Mosaic, reference: int) -> WrittenMosaic | None:
        picture = mosaic.picture()
        if picture is None or (not is_numbered(self._location) and mosaic.covered_px <= self._largest):
            return None
        path = location_of(self._location, reference)
        write_picture(picture, path)
        self._largest = mosaic.covered_px
        height, width = picture.shape[:2]
        return WrittenMosaic(path, reference, width, height, mosaic.scale, mosaic.pictures)
