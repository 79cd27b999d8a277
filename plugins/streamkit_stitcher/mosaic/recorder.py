"""Which frames go into a mosaic, and when it is written."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, corners, project
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.frame_views import FrameView, Position, focal_length
from streamkit_stitcher.mosaic.mosaic_frames import AdjustedPlanes, MosaicFrames, WrittenMosaic
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import FrameRegistration

_MIN_NEW_GROUND: Final = 0.08
# Motion between frames that are compared for graphics: beyond it edges of the ground are elsewhere.
_MIN_MOTION_PX: Final = 8.0
_BYTES_PER_PIXEL: Final = 3
_MANY_FRAMES: Final = 10_000
_MAX_VIEWS: Final = 4000


class MosaicRecorder:
    """Selects the frames of mosaics, and writes these.

    Keyframes are added, and measured frames that show new ground. With `%d` in the location each plane gets a
    file; otherwise the largest is kept. The frames of a plane that ends stay until the mosaics are written,
    as later frames may join it. The selection is immediate; `run` does the rest in the same order, so that
    the mosaic is the same, and `frames` belongs to its thread.

    Args:
        settings: how mosaics are made.
        run: runs the tasks that store, paint and write, with the bytes that each holds until then.
        report_progress: called by long tasks from time to time; an exception of it ends them.

    Attributes:
        frames: the frames of the current plane.
        refused: number of frames that no mosaic accepts, out of reach or degenerate.
        keeps_planes: whether frames of a plane that ended can still be used; else write it first.
    """

    def __init__(
        self,
        settings: RecorderSettings,
        run: Callable[[Callable[[], object], int], object] = lambda task, _: task(),
        report_progress: Callable[[], None] = lambda: None,
    ) -> None:
        self._run = run
        self.frames = MosaicFrames(settings, report_progress)
        self.refused = 0
        self.keeps_planes = settings.is_stored
        self._reference = 0
        self._since_graphics, self._frames_between, self._compared = IDENTITY, 0, 0
        self._begin()

    def _begin(self) -> None:
        """Begins with what the next mosaics are made of."""
        self._coverage = Coverage()
        self._added = 0
        self._views, self._stride, self._skipped = list[FrameView](), 1, 0

    @property
    def has_room(self) -> bool:
        """Whether there is room for many more frames before the mosaics must be written."""
        return self._added < _MANY_FRAMES

    @property
    def is_empty(self) -> bool:
        """Whether the current plane has no frame yet."""
        return self._coverage.is_empty

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

        A frame of a new plane starts another mosaic: write the previous one first unless `keeps_planes`.
        `load` returns the pixels and is called only for frames that are added, or compared for graphics.

        Raises:
            OSError: there is no room for a temporary file.
        """
        if self.is_new_plane(registered):
            self._coverage = Coverage()
            self._run(partial(self.frames.begin_plane, registered.reference), 0)
        elif registered.rebase is not None:
            self._coverage.move_plane(registered.rebase)
            self._run(partial(self.frames.rebase, registered.rebase, registered.reference), 0)
        self._reference = registered.reference
        self._since_graphics = self._since_graphics @ registered.to_previous
        if not registered.measured:
            return False
        size = shape[0] * shape[1] * _BYTES_PER_PIXEL
        if self.keeps_planes and self._is_due_for_graphics(shape):
            self._run(partial(self.frames.look_for_graphics, load), size)
        self._add_view(registered, shape, position)
        new_ground = self._coverage.uncovered(shape, registered.to_reference) > _MIN_NEW_GROUND
        if not (registered.keyframe or new_ground):
            return False
        if not self._coverage.add(shape, registered.to_reference):
            self.refused += 1
            return False
        self._added += 1
        self._run(partial(self.frames.add, registered, shape, load), size)
        return True

    def _is_due_for_graphics(self, shape: tuple[int, int]) -> bool:
        """Whether all of the ground moved since the last comparison; ever fewer are due in a long flight."""
        self._frames_between += 1
        if self._frames_between <= self._compared / 16:
            return False
        outline = corners(shape)
        moved = np.hypot(*(project(self._since_graphics, outline) - outline).T).min()
        if moved <= _MIN_MOTION_PX:
            return False
        self._since_graphics, self._frames_between = IDENTITY, 0
        self._compared += 1
        return True

    def _add_view(self, registered: FrameRegistration, shape: tuple[int, int], position: Position) -> None:
        """Keeps what a frame shows of the earth, of a long flight that of every few frames."""
        self._skipped = (self._skipped + 1) % self._stride
        if position is None or self._skipped:
            return
        self._views.append(FrameView(registered.key_index, registered.to_key, shape, position))
        if len(self._views) > _MAX_VIEWS:
            del self._views[::2]
            self._stride *= 2

    def save(self) -> None:
        """Writes the current mosaic as painted so far, and keeps painting it; see `MosaicFrames.save`."""
        self._run(partial(self.frames.save, self._coverage.covered_px), 0)

    def writing(
        self,
        adjust: Callable[[float], AdjustedPlanes],
        written: Callable[[WrittenMosaic], None] = lambda _: None,
    ) -> Callable[[], None]:
        """The task that writes the mosaics of everything added before; the next ones begin here.

        `adjust` returns the homographies of the keyframes, adjusted with the focal length, px, 0 if unknown;
        `written` is called with each result. The task raises an OSError where one could not be written.
        """
        covered_px, reference, views = self._coverage.covered_px, self._reference, self._views
        self._begin()

        def write() -> None:
            try:
                for result in self.frames.write(covered_px, adjust(focal_length(views)), views):
                    written(result)
            finally:
                self.frames.close()
                self.frames.clear(reference)

        return write

    def finish(
        self, planes: Mapping[int, Mapping[int, FloatArray]] | None = None, rmse: float = 0.0
    ) -> WrittenMosaic | None:
        """Writes the mosaics now, see `writing`; returns the last.

        Raises:
            OSError: it could not be written.
        """
        results: list[WrittenMosaic] = []
        self.writing(lambda _: (planes or {}, rmse), results.append)()
        return results[-1] if results else None

    def close(self) -> None:
        """Releases everything that was not written; no task may run any more."""
        self.frames.close()
