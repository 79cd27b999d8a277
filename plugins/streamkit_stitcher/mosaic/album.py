"""The pictures of one plane: kept for the end, painted as they come, and written when the plane is left."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, inverse, normalised
from streamkit_stitcher.mosaic.composition import Composition, PlacedPicture, compose
from streamkit_stitcher.mosaic.georeference import Georeference, PositionFix, georeference
from streamkit_stitcher.mosaic.geotiff import north_up
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.picture_file import is_numbered, is_tiff, location_of, write_picture
from streamkit_stitcher.mosaic.picture_store import PictureStore
from streamkit_stitcher.mosaic.seams import SeamKind
from streamkit_stitcher.mosaic.tiles import PictureArray

# As many as there are places of key pictures to put them at.
_MOST_KEPT: Final = 20_000


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
    seam: SeamKind = SeamKind.GRAPHCUT


@dataclass(frozen=True, eq=False)
class ChosenPicture:
    """A picture that goes into the mosaic.

    Attributes:
        shape: (height, width), px.
        to_reference: float64[3, 3], its pixels to the plane as it is when the picture comes.
        fills_gaps: whether it shows only where no other picture does.
        key: the key picture that places it at the end.
        to_key: float64[3, 3], its pixels to those of that one.
        position: where the camera was, or None.
    """

    shape: tuple[int, int]
    to_reference: FloatArray
    fills_gaps: bool
    key: int
    to_key: FloatArray
    position: PositionFix | None = None


@dataclass(frozen=True, eq=False)
class _Kept:
    """A picture in the store, where it lay on the first plane when it came, and what places it at the end."""

    picture: PlacedPicture
    key: int
    to_key: FloatArray
    position: PositionFix | None


class Album:
    """The pictures of the current plane, and the mosaic as it grows.

    While pictures are kept for the end and nobody asks for the growing mosaic, it is not painted.

    Args:
        settings: how.
        breathe: called before each picture that is read or painted; what it raises ends the work.
    """

    def __init__(self, settings: RecorderSettings, breathe: Callable[[], None] = lambda: None) -> None:
        self._settings = settings
        self._breathe = breathe
        self._largest = 0.0
        self._grown: Mosaic | None = None
        self.begin(0)

    @property
    def reference(self) -> int:
        """Number of the current plane."""
        return self._reference

    @property
    def mosaic(self) -> Mosaic:
        """The mosaic of the current plane as it grows; asking for it has it painted from now on."""
        if self._grown is None:
            self._grown = self._painted()
        return self._grown

    def begin(self, reference: int) -> None:
        """Opens another plane, of that number, without pictures."""
        self._grown = None if self._keeps else Mosaic(self._settings.memory_px)
        self._store = PictureStore()
        self._kept: list[_Kept] = []
        self._reference = reference
        self._to_first = IDENTITY

    def follow(self, change: FloatArray, reference: int) -> None:
        """Moves with the plane by float64[3, 3], old to new, which then has the number `reference`."""
        self._reference = reference
        self._to_first = normalised(self._to_first @ inverse(change))
        if self._grown is not None:
            self._grown.canvas.move_plane(change)

    def add(self, chosen: ChosenPicture, picture: Callable[[], PictureArray]) -> None:
        """Takes a picture: uint8[h, w] or uint8[h, w, 3] BGR.

        Raises:
            OSError: a temporary file takes no more.
        """
        self._breathe()
        pixels = picture()
        if self._keeps and len(self._kept) <= _MOST_KEPT:
            number = self._store.add(pixels) if len(self._kept) < _MOST_KEPT else None
            if number is None:
                # What does not fit in the store can only be painted, on top of all that came before.
                _ = self.mosaic
            place = normalised(self._to_first @ chosen.to_reference)
            placed = PlacedPicture(-1 if number is None else number, chosen.shape, place, chosen.fills_gaps)
            self._kept.append(_Kept(placed, chosen.key, chosen.to_key, chosen.position))
        if self._grown is not None:
            self._grown.add(pixels, chosen.to_reference, chosen.fills_gaps)

    def write(
        self, covered_px: float, places: Mapping[int, FloatArray] | None, rmse: float
    ) -> WrittenMosaic | None:
        """Writes the mosaic of the current plane.

        Args:
            covered_px: area that the pictures cover; the largest is kept where all have one file.
            places: adjusted places of the key pictures by their numbers; None for the mosaic as it grew.
            rmse: of the tie points of the adjustment, px.

        Returns:
            What was written; None where there is nothing, or a larger one was written before.

        Raises:
            OSError: it could not be written.
        """
        location = self._settings.location
        if location is None or (not is_numbered(location) and covered_px <= self._largest):
            return None
        self._largest = covered_px
        placed, fixes = _placed(self._kept, places) if places is not None else ([], [])
        whole = self._composed(location, placed, fixes)
        final = whole is not None
        if whole is None:
            whole = _as_it_grew(self.mosaic)
        if whole is None:
            return None
        geo = _georeferenced(whole.from_plane, fixes)
        path = location_of(location, self._reference)
        self._breathe()
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

    def close(self) -> None:
        """Lets go of everything that was not written."""
        if self._grown is not None:
            self._grown.canvas.close()
        self._store.close()

    @property
    def _keeps(self) -> bool:
        return self._settings.final and self._settings.location is not None

    def _load(self, number: int) -> PictureArray:
        self._breathe()
        return self._store.get(number)

    def _painted(self) -> Mosaic:
        """The pictures kept so far, laid side by side as they came."""
        mosaic = Mosaic(self._settings.memory_px)
        for item in self._kept:
            if item.picture.number >= 0:
                mosaic.add(self._load(item.picture.number), item.picture.to_plane, item.picture.fills_gaps)
        mosaic.canvas.move_plane(inverse(self._to_first))
        return mosaic

    def _composed(
        self,
        location: str,
        placed: Sequence[PlacedPicture],
        fixes: Sequence[tuple[PlacedPicture, PositionFix]],
    ) -> Composition | None:
        """The mosaic of the pictures at their adjusted places, or None where one of them was not kept."""
        if not placed or any(picture.number < 0 for picture in placed):
            return None
        turn = _turn(location, fixes)
        turned = [replace(picture, to_plane=normalised(turn @ picture.to_plane)) for picture in placed]
        whole = compose(turned, self._load, self._settings.seam, self._settings.memory_px)
        return None if whole is None else replace(whole, from_plane=normalised(whole.from_plane @ turn))


def _as_it_grew(mosaic: Mosaic) -> Composition | None:
    grown = mosaic.picture()
    if grown is None:
        return None
    left, top, _, _ = mosaic.canvas.box
    shift = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
    return Composition(grown, normalised(shift @ mosaic.canvas.from_plane), mosaic.scale, mosaic.pictures)


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
