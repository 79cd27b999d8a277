"""Which pictures go into a mosaic, and when a mosaic is finished."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from streamkit_stitcher.homographies import IDENTITY, FloatArray, inverse, normalised
from streamkit_stitcher.mosaic.composition import Composition, PlacedPicture, compose
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.georeference import Georeference, PositionFix, georeference
from streamkit_stitcher.mosaic.geotiff import north_up
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.picture_file import is_numbered, is_tiff, location_of, write_picture
from streamkit_stitcher.mosaic.picture_store import PictureStore
from streamkit_stitcher.mosaic.seams import SeamKind
from streamkit_stitcher.mosaic.tiles import PictureArray
from streamkit_stitcher.plane.placement import Placement

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
        final: whether its pictures were adjusted together and blended, not only laid side by side.
        rmse_px: root mean square residual of the tie points of that adjustment, or None.
        position_misfit_m: median distance between the pictures' positions and the mosaic's, or None.
    """

    path: Path
    reference: int
    width: int
    height: int
    scale: float
    pictures: int
    final: bool = False
    rmse_px: float | None = None
    position_misfit_m: float | None = None


@dataclass(frozen=True)
class RecorderSettings:
    """How mosaics are made.

    Attributes:
        location: path of the mosaic, see `picture_file.check_location`; None where only a preview is wanted.
        memory_px: most pixels of a mosaic kept in memory.
        final: whether pictures are kept to be blended at the end.
        seam: how they share the ground then.
    """

    location: str | None
    memory_px: int
    final: bool = True
    seam: SeamKind = SeamKind.VORONOI


@dataclass(frozen=True, eq=False)
class _Kept:
    """A picture in the store, where it lay on the first plane when it came, and what places it at the end."""

    picture: PlacedPicture
    key: int
    to_key: FloatArray
    position: PositionFix | None


class MosaicRecorder:
    """Keeps the mosaic of the current plane and writes those that are finished.

    Key pictures go in, and pictures that show ground not seen before; a picture whose place was not measured
    never does. With `%d` in the location each plane gets a file; otherwise the one that covers most is kept.

    While pictures are kept for the end and nobody watches the mosaic grow, it is not painted.

    Args:
        settings: how.
    """

    def __init__(self, settings: RecorderSettings) -> None:
        self._settings = settings
        self._largest = 0.0
        self._refused = 0
        self._grown: Mosaic | None = None
        self._begin(0)

    @property
    def refused(self) -> int:
        """Pictures that no mosaic could take, being out of reach or degenerate."""
        return self._refused

    @property
    def is_empty(self) -> bool:
        """Whether the current plane has no picture yet."""
        return self._ground.is_empty

    @property
    def mosaic(self) -> Mosaic:
        """The mosaic of the current plane as it grows; asking for it has it painted from now on."""
        if self._grown is None:
            self._grown = self._painted()
        return self._grown

    @property
    def reference(self) -> int:
        """Number of the current plane."""
        return self._reference

    def is_other_plane(self, placement: Placement) -> bool:
        """Whether a picture lies on a plane that nothing relates to the mosaic's."""
        return placement.reference != self._reference and placement.change is None

    def add(
        self,
        placement: Placement,
        shape: tuple[int, int],
        picture: Callable[[], PictureArray],
        position: PositionFix | None = None,
    ) -> bool:
        """Takes a placed picture where it is worth it.

        A picture of another plane begins another mosaic: `finish` the one before first.

        Args:
            placement: where it lies.
            shape: (height, width), px.
            picture: gives uint8[h, w] or uint8[h, w, 3] BGR; called only when the picture goes in.
            position: where the camera was, if that is known.

        Returns:
            Whether the mosaic changed.

        Raises:
            OSError: a temporary file takes no more.
        """
        if self.is_other_plane(placement):
            self._begin(placement.reference)
        if placement.change is not None:
            self._follow(placement.change)
        self._reference = placement.reference
        if not placement.anchored or not (placement.keyframe or self._is_new_ground(shape, placement)):
            return False
        if not self._ground.add(shape, placement.to_reference):
            self._refused += 1
            return False
        pixels = picture()
        fills_gaps = not placement.keyframe
        if self._keeps:
            number = self._store.add(pixels)
            if number is None:
                # What does not fit in the store can only be painted, on top of all that came before.
                _ = self.mosaic
            place = normalised(self._to_first @ placement.to_reference)
            placed = PlacedPicture(-1 if number is None else number, shape, place, fills_gaps)
            self._kept.append(_Kept(placed, placement.key_index, placement.to_key, position))
        if self._grown is not None:
            self._grown.add(pixels, placement.to_reference, fills_gaps)
        return True

    def finish(
        self, places: Mapping[int, FloatArray] | None = None, rmse: float = 0.0
    ) -> WrittenMosaic | None:
        """Writes the current mosaic, once.

        Args:
            places: adjusted places of the key pictures by their numbers; None for the mosaic as it grew.
            rmse: of the tie points of the adjustment, px.

        Returns:
            What was written; None where there is nothing, or a larger one was written before.

        Raises:
            OSError: it could not be written.
        """
        try:
            return self._write(places, rmse)
        finally:
            self.close()
            self._begin(self._reference)

    def close(self) -> None:
        """Lets go of everything that was not written."""
        if self._grown is not None:
            self._grown.canvas.close()
        self._ground.close()
        self._store.close()

    @property
    def _keeps(self) -> bool:
        return self._settings.final and self._settings.location is not None

    def _begin(self, reference: int) -> None:
        self._grown = None if self._keeps else Mosaic(self._settings.memory_px)
        self._ground = Coverage(self._settings.memory_px)
        self._store = PictureStore()
        self._kept: list[_Kept] = []
        self._reference = reference
        self._to_first = IDENTITY

    def _follow(self, change: FloatArray) -> None:
        """Moves with the plane by float64[3, 3], old to new."""
        self._ground.move_plane(change)
        self._to_first = normalised(self._to_first @ inverse(change))
        if self._grown is not None:
            self._grown.canvas.move_plane(change)

    def _painted(self) -> Mosaic:
        """The pictures kept so far, laid side by side as they came."""
        mosaic = Mosaic(self._settings.memory_px)
        for item in self._kept:
            if item.picture.number >= 0:
                mosaic.add(
                    self._store.get(item.picture.number), item.picture.to_plane, item.picture.fills_gaps
                )
        mosaic.canvas.move_plane(inverse(self._to_first))
        return mosaic

    def _is_new_ground(self, shape: tuple[int, int], placement: Placement) -> bool:
        return self._ground.uncovered(shape, placement.to_reference) > _WORTH_ADDING

    def _write(self, places: Mapping[int, FloatArray] | None, rmse: float) -> WrittenMosaic | None:
        location = self._settings.location
        if location is None or self.is_empty:
            return None
        if not is_numbered(location) and self._ground.covered_px <= self._largest:
            return None
        self._largest = self._ground.covered_px
        placed, fixes = _placed(self._kept, places) if places is not None else ([], [])
        whole: Composition | None = None
        if placed and all(picture.number >= 0 for picture in placed):
            turn = _turn(location, fixes)
            turned = [replace(picture, to_plane=normalised(turn @ picture.to_plane)) for picture in placed]
            whole = compose(turned, self._store.get, self._settings.seam, self._settings.memory_px)
            if whole is not None:
                whole = replace(whole, from_plane=normalised(whole.from_plane @ turn))
        final = whole is not None
        if whole is None:
            mosaic = self.mosaic
            grown = mosaic.picture()
            if grown is None:
                return None
            left, top, _, _ = mosaic.canvas.box
            shift = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
            whole = Composition(
                grown, normalised(shift @ mosaic.canvas.from_plane), mosaic.scale, mosaic.pictures
            )
        geo = _georeferenced(whole.from_plane, fixes)
        path = location_of(location, self._reference)
        write_picture(whole.picture, path, geo)
        height, width = whole.picture.shape[:2]
        return WrittenMosaic(
            path,
            self._reference,
            width,
            height,
            whole.scale,
            whole.pictures,
            final,
            rmse if final else None,
            None if geo is None else geo.misfit_m,
        )


def _placed(
    kept: list[_Kept], places: Mapping[int, FloatArray]
) -> tuple[list[PlacedPicture], list[tuple[PlacedPicture, PositionFix]]]:
    """The pictures at the adjusted places of their key pictures, and those whose position is known."""
    placed, fixes = [], []
    for item in kept:
        if item.key in places:
            picture = replace(item.picture, to_plane=normalised(places[item.key] @ item.to_key))
            placed.append(picture)
            if item.position is not None:
                fixes.append((picture, item.position))
    return placed, fixes


def _turn(location: str, fixes: Sequence[tuple[PlacedPicture, PositionFix]]) -> FloatArray:
    """How the plane is turned for the mosaic: a GeoTIFF with north on top, others not at all."""
    geo = _georeferenced(IDENTITY, fixes) if is_tiff(location) else None
    return IDENTITY if geo is None else north_up(geo)


def _georeferenced(
    from_plane: FloatArray, fixes: Sequence[tuple[PlacedPicture, PositionFix]]
) -> Georeference | None:
    if not fixes:
        return None
    return georeference(
        [normalised(from_plane @ picture.to_plane) for picture, _ in fixes],
        [picture.shape for picture, _ in fixes],
        [fix for _, fix in fixes],
    )
