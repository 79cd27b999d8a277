"""Which frames go into a mosaic, and when it is written."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from threading import Event
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, corners, project
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.frame_views import FrameView, Position, focal_length
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.mosaic_frames import MosaicFrames, RecorderSettings, WrittenMosaic
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import FrameRegistration

_MIN_NEW_GROUND: Final = 0.08
# Motion between frames that are compared for graphics: beyond it edges of the ground are elsewhere.
_LEAST_MOTION_PX: Final = 8.0
_BYTES_PER_PIXEL: Final = 3

# Homographies of the keyframes of each plane, None for the incremental mosaic, and the rmse of the ties, px.
AdjustedPlanes = tuple[Mapping[int, Mapping[int, FloatArray]] | None, float]
_MANY_FRAMES: Final = 10_000
_MOST_VIEWS: Final = 4000


class MosaicRecorder:
    """Selects the frames of mosaics, and writes these.

    Keyframes are added, and measured frames that show new ground. With `%d` in the location each plane gets a
    file; otherwise the largest is kept. The frames of a plane that ends stay until the mosaics are written,
    as later frames may join it. The selection is immediate; with an executor, everything else runs
    there in the same order, so that the mosaic is the same, and `mosaic` belongs to its thread.

    Args:
        settings: how mosaics are made.
        executor: stores, paints and writes in the background; None for the caller's thread.
        cancelled: ends waits for a busy executor.

    Attributes:
        frames: the frames of the current plane.
        refused: number of frames that no mosaic accepts, out of reach or degenerate.
    """

    def __init__(
        self,
        settings: RecorderSettings,
        executor: BackgroundExecutor | None = None,
        cancelled: Event | None = None,
    ) -> None:
        self._settings = settings
        self._executor = executor
        self._cancelled = cancelled
        report = (lambda: None) if executor is None else executor.report_progress
        self.frames = MosaicFrames(settings, report)
        self.refused = 0
        self._coverage = Coverage()
        self._reference = self._added = 0
        self._views, self._stride, self._skipped = list[FrameView](), 1, 0
        self._since_graphics, self._frames_between, self._compared = IDENTITY, 0, 0

    @property
    def keeps_planes(self) -> bool:
        """Whether frames of a plane that ended can still be used; else write it first."""
        return self._settings.final and self._settings.location is not None

    @property
    def has_room(self) -> bool:
        """Whether there is room for many more frames before the mosaics must be written."""
        return self._added < _MANY_FRAMES

    @property
    def is_empty(self) -> bool:
        """Whether the current plane has no frame yet."""
        return self._coverage.is_empty

    @property
    def mosaic(self) -> Mosaic:
        """The incremental mosaic of the current plane; painted from the first use on."""
        return self.frames.mosaic

    def is_new_plane(self, registered: FrameRegistration) -> bool:
        """Whether a frame lies on a plane that needs another mosaic."""
        if registered.opens_plane:
            return True
        return registered.reference != self._reference and registered.reference_change is None

    def add(
        self,
        registered: FrameRegistration,
        shape: tuple[int, int],
        load: Callable[[], ImageArray],
        position: Position = None,
    ) -> bool:
        """Adds a registered frame where the mosaic needs it; whether the mosaic changes.

        A frame of a new plane starts another mosaic: `finish` the previous one first unless `keeps_planes`.
        `load` returns the pixels and is called only for frames that are added, or compared for graphics.

        Raises:
            OSError: a temporary file is full.
        """
        if self.is_new_plane(registered):
            self._coverage = Coverage()
            self._do(partial(self.frames.begin_plane, registered.reference))
        elif registered.rebase is not None:
            self._coverage.move_plane(registered.rebase)
            self._do(partial(self.frames.rebase, registered.rebase, registered.reference))
        self._reference = registered.reference
        if self.keeps_planes:
            self._since_graphics = self._since_graphics @ registered.to_previous
        if not registered.measured:
            return False
        if self.keeps_planes:
            self._look_for_graphics(shape, load)
        self._add_view(registered, shape, position)
        new_ground = self._coverage.uncovered(shape, registered.to_reference) > _MIN_NEW_GROUND
        if not (registered.keyframe or new_ground):
            return False
        if not self._coverage.add(shape, registered.to_reference):
            self.refused += 1
            return False
        self._added += 1
        work = partial(self.frames.add, registered, shape, load)
        self._do(work, shape[0] * shape[1] * _BYTES_PER_PIXEL)
        return True

    def _look_for_graphics(self, shape: tuple[int, int], load: Callable[[], ImageArray]) -> None:
        """Compares frames between which all of the ground moved; ever fewer in a long flight."""
        self._frames_between += 1
        if self._frames_between <= self._compared / 16:
            return
        outline = corners(shape)
        moved = np.hypot(*(project(self._since_graphics, outline) - outline).T).min()
        if moved > _LEAST_MOTION_PX:
            self._since_graphics, self._frames_between = IDENTITY, 0
            self._compared += 1
            self._do(partial(self.frames.look_for_graphics, load), shape[0] * shape[1] * _BYTES_PER_PIXEL)

    def _add_view(self, registered: FrameRegistration, shape: tuple[int, int], position: Position) -> None:
        """Keeps what a frame shows of the earth, of a long flight that of every few frames."""
        self._skipped = (self._skipped + 1) % self._stride
        if position is None or self._skipped:
            return
        self._views.append(FrameView(registered.key_index, registered.to_key, shape, position))
        if len(self._views) > _MOST_VIEWS:
            del self._views[::2]
            self._stride *= 2

    def save(self) -> None:
        """Writes the current mosaic as painted so far, and keeps painting it; see `MosaicFrames.save`."""
        self._do(partial(self.frames.save, self._coverage.covered_px))

    def start_writing(
        self,
        adjust: Callable[[float], AdjustedPlanes],
        written: Callable[[WrittenMosaic], None] = lambda _: None,
    ) -> "Future[None]":
        """Writes the mosaics of everything added before, and forgets it.

        `adjust` returns the homographies of the keyframes, adjusted with the focal length, px, 0 if unknown;
        `written` is called with each result. The
        future is done when the files are; it has an OSError where one could not be written.
        """
        work = partial(self._write, self._coverage.covered_px, self._reference, adjust, written, self._views)
        self._views, self._stride, self._skipped = [], 1, 0
        self._coverage = Coverage()
        self._added = 0
        if self._executor is not None:
            return self._executor.submit(work)
        future: Future[None] = Future()
        try:
            future.set_result(work())
        except Exception as error:
            future.set_exception(error)
        return future

    def finish(
        self, homographies: Mapping[int, FloatArray] | None = None, rmse: float = 0.0
    ) -> WrittenMosaic | None:
        """Writes the mosaic of a single plane and waits for it; see `finish_planes`."""
        return self.finish_planes(None if homographies is None else {self._reference: homographies}, rmse)

    def finish_planes(
        self, planes: Mapping[int, Mapping[int, FloatArray]] | None, rmse: float
    ) -> WrittenMosaic | None:
        """Writes the mosaics and waits for them, see `start_writing`; returns the last.

        Raises:
            OSError: it could not be written.
        """
        results: list[WrittenMosaic] = []
        self.start_writing(lambda _: (planes, rmse), results.append).result()
        return results[-1] if results else None

    def close(self) -> None:
        """Releases everything that was not written; the executor must have ended."""
        self.frames.close()

    def _do(self, work: Callable[[], object], size: int = 0) -> None:
        if self._executor is None:
            work()
        else:
            self._executor.submit_waiting(work, size, self._cancelled)

    def _write(
        self,
        covered_px: float,
        reference: int,
        adjust: Callable[[float], AdjustedPlanes],
        written: Callable[[WrittenMosaic], None],
        views: Sequence[FrameView],
    ) -> None:
        try:
            for result in self.frames.write(covered_px, *adjust(focal_length(views)), views):
                written(result)
        finally:
            self.frames.close()
            self.frames.clear(reference)
