"""The frames of mosaics: stored for the end, painted incrementally, and written."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, inverse, normalised, translation
from streamkit_stitcher.mosaic.composition import Composition, PlacedFrame, compose
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.frame_store import FrameStore
from streamkit_stitcher.mosaic.frame_views import FrameView, focal_length, georeferenced
from streamkit_stitcher.mosaic.georeference import Georeference
from streamkit_stitcher.mosaic.geotiff import north_up
from streamkit_stitcher.mosaic.graphics import OverlaidGraphics
from streamkit_stitcher.mosaic.image_file import is_numbered, is_tiff, location_of, write_image
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import FrameRegistration

# Homographies of the keyframes of each plane, none for the incremental mosaic, and the rmse of the ties, px.
AdjustedPlanes = tuple[Mapping[int, Mapping[int, FloatArray]], float]


@dataclass(frozen=True)
class WrittenMosaic:
    """A mosaic that was written.

    Attributes:
        path: the file.
        reference: number of its plane.
        width: px.
        height: px.
        scale: its pixels per px of the plane.
        pictures: number of frames in it.
        final: whether its frames were adjusted together and blended.
        rmse_px: root mean square residual of the tie points of that adjustment, or None.
        position_misfit_m: median distance between the frames' positions and the mosaic's, or None.
        geo_error_m: expected error of a place in it, or None where it has no position.
        ground_resolution_m: size of its middle pixel on the ground, or None.
        geo_refused: why it has no position on the earth; empty where it has.
    """

    path: Path
    reference: int
    width: int
    height: int
    scale: float
    pictures: int
    final: bool
    rmse_px: float | None
    position_misfit_m: float | None
    geo_error_m: float | None
    ground_resolution_m: float | None
    geo_refused: str


class MosaicFrames:
    """The frames of all planes, and the mosaic of the current one that is painted incrementally.

    Frames of earlier planes stay, as their planes may be joined. While frames are stored for the final
    mosaic, the incremental one is painted only once it is asked for.

    Args:
        settings: how mosaics are made.
        report_progress: called before each frame is read or painted; an exception of it ends the work.

    Attributes:
        reference: number of the current plane.
        graphics: what does not show the ground in the frames.
    """

    def __init__(
        self, settings: RecorderSettings, report_progress: Callable[[], None] = lambda: None
    ) -> None:
        self._settings = settings
        self._report_progress = report_progress
        self._largest_px = 0.0
        self._mosaic: Mosaic | None = None
        self.graphics = OverlaidGraphics()
        self.clear(0)

    @property
    def mosaic(self) -> Mosaic:
        """The incremental mosaic of the current plane; painted from the first use on."""
        if self._mosaic is None:
            self._mosaic = Mosaic(self._settings.memory_px)
            for placed, _ in self._frames[self._first_of_plane :]:
                self._mosaic.add(self._load(placed.number), placed.to_plane, placed.fills_gaps)
            self._mosaic.move_plane(inverse(self._to_first))
        return self._mosaic

    def clear(self, reference: int) -> None:
        """Forgets all frames, and starts the plane of that number."""
        self._store = FrameStore()
        # Where each frame lay at the beginning of its plane, and what places it at the end.
        self._frames: list[tuple[PlacedFrame, FrameRegistration]] = []
        self.begin_plane(reference)

    def begin_plane(self, reference: int) -> None:
        """Starts another plane, of that number; the frames of earlier ones are kept."""
        if self._mosaic is not None:
            self._mosaic.close()
        self._mosaic = None
        # Until the store is full: the first frame that it refuses is the last one that is noted.
        self._is_stored = self._settings.is_stored
        self._first_of_plane = len(self._frames)
        self.reference = reference
        self._to_first = IDENTITY

    def rebase(self, change: FloatArray, reference: int) -> None:
        """Follows a change of the plane, float64[3, 3] old to new, to the number `reference`."""
        self.reference = reference
        self._to_first = normalised(self._to_first @ inverse(change))
        if self._mosaic is not None:
            self._mosaic.move_plane(change)

    def add(
        self, registered: FrameRegistration, shape: tuple[int, int], load: Callable[[], ImageArray]
    ) -> None:
        """Adds a frame, whose pixels `load` returns; all but keyframes only fill gaps.

        Raises:
            OSError: there is no room for a temporary file.
        """
        self._report_progress()
        pixels, fills_gaps = load(), not registered.keyframe
        number = self._store.add(pixels) if self._is_stored else None
        # Frames that are not stored can only be painted, on top of the earlier ones.
        mosaic = self.mosaic if number is None else self._mosaic
        if self._is_stored:
            matrix = normalised(self._to_first @ registered.to_reference)
            placed = PlacedFrame(-1 if number is None else number, shape, matrix, fills_gaps)
            self._frames.append((placed, registered))
            self._is_stored = number is not None
        if mosaic is not None:
            mosaic.add(pixels, registered.to_reference, fills_gaps)

    def look_for_graphics(self, load: Callable[[], ImageArray]) -> None:
        """Compares a frame with the last that was given here, which showed the ground elsewhere."""
        self.graphics.add(load())

    def write(
        self, covered_px: float, planes: AdjustedPlanes, views: Sequence[FrameView] = ()
    ) -> Iterator[WrittenMosaic]:
        """Writes the mosaics of all planes with frames; of planes that share one file the largest only.

        Args:
            covered_px: area of the current plane that its frames cover.
            planes: the planes after adjustment.
            views: what frames show of the earth.

        Raises:
            OSError: one could not be written.
        """
        location, (homographies, rmse) = self._settings.location, planes
        if location is None:
            return
        placed = {number: self._adjusted(own) for number, own in homographies.items()}
        areas = {number: _covered_px(own) for number, own in placed.items() if own}
        if not areas:
            placed, areas = {self.reference: []}, {self.reference: covered_px}
        if not is_numbered(location):
            largest = max(areas, key=lambda number: areas[number])
            areas = {largest: areas[largest]} if areas[largest] > self._largest_px else {}
        for number, area in areas.items():
            self._largest_px = max(self._largest_px, area)
            own, focal_px = homographies.get(number, {}), focal_length(views)
            found = georeferenced(own, views, self._settings.max_geo_error_m, focal_px)
            written = self._written(location, number, placed[number], rmse, *found)
            if written is not None:
                yield written

    def _written(
        self,
        location: str,
        number: int,
        placed: Sequence[PlacedFrame],
        rmse: float,
        geo: Georeference | None,
        refused: str,
    ) -> WrittenMosaic | None:
        misfit = None if geo is None else geo.median_error_m
        geo = None if refused else geo
        whole = self._composed(placed, north_up(geo) if geo is not None and is_tiff(location) else IDENTITY)
        final = whole is not None
        whole = whole or _incremental(self.mosaic)
        if whole is None:
            return None
        geo = None if geo is None else geo.seen_through(whole.from_plane)
        if geo is not None and is_tiff(location) and not geo.is_affine:
            geo, refused = None, "the camera looks aside, and only the final mosaic can follow that"
        path = location_of(location, number + self._settings.first_number)
        self._report_progress()
        write_image(whole.image, path, geo)
        height, width = whole.image.shape[:2]
        return WrittenMosaic(
            path,
            number,
            width,
            height,
            whole.scale,
            whole.frames,
            final,
            rmse if final else None,
            misfit,
            None if geo is None else geo.error_m,
            None if geo is None else geo.pixel_size_m((height, width)),
            refused,
        )

    def save(self, covered_px: float) -> None:
        """Writes the incremental mosaic, so that a process that is killed leaves one; see `write`.

        Raises:
            OSError: it could not be written.
        """
        location = self._settings.location
        if location is None or (not is_numbered(location) and covered_px <= self._largest_px):
            return
        if (image := self.mosaic.image()) is not None:
            write_image(image, location_of(location, self.reference + self._settings.first_number))

    def close(self) -> None:
        """Releases everything that was not written."""
        if self._mosaic is not None:
            self._mosaic.close()
        self._store.close()

    def _load(self, number: int) -> ImageArray:
        self._report_progress()
        return self._store.get(number)

    def _adjusted(self, homographies: Mapping[int, FloatArray]) -> list[PlacedFrame]:
        """The frames by the adjusted homographies of their keyframes."""
        return [
            replace(placed, to_plane=normalised(homographies[registered.key_index] @ registered.to_key))
            for placed, registered in self._frames
            if registered.key_index in homographies
        ]

    def _composed(self, placed: Sequence[PlacedFrame], turn: FloatArray) -> Composition | None:
        """The final mosaic on a turned plane; None without frames, or where not all were stored."""
        if any(frame.number < 0 for frame in placed):
            return None
        turned = [replace(frame, to_plane=normalised(turn @ frame.to_plane)) for frame in placed]
        seam, memory_px = self._settings.seam, self._settings.memory_px
        whole = compose(turned, self._load, seam, memory_px, self.graphics.mask)
        return None if whole is None else replace(whole, from_plane=normalised(whole.from_plane @ turn))


def _covered_px(placed: Sequence[PlacedFrame]) -> float:
    coverage = Coverage()
    for frame in placed:
        coverage.add(frame.shape, frame.to_plane)
    return coverage.covered_px


def _incremental(mosaic: Mosaic) -> Composition | None:
    image = mosaic.image()
    if image is None:
        return None
    from_plane = normalised(translation(-np.array(mosaic.box[:2])) @ mosaic.from_plane)
    return Composition(image, from_plane, mosaic.scale, mosaic.frames)
