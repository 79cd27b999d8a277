"""Which frames go into a mosaic, and when it is written."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from threading import Event
from typing import Final

from streamkit.geometry.homography import FloatArray
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.mosaic_frames import MosaicFrames, RecorderSettings, WrittenMosaic
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.plane.frame_registration import FrameRegistration

_MIN_NEW_GROUND: Final = 0.08
_BYTES_PER_PIXEL: Final = 3

# Homographies of the keyframes, None for the incremental mosaic, and the rmse of the ties, px.
AdjustedHomographies = tuple[Mapping[int, FloatArray] | None, float]


class MosaicRecorder:
    """Selects the frames of the current plane's mosaic, and writes finished mosaics.

    Keyframes are added, and measured frames that show new ground. With `%d` in the location each plane gets a
    file; otherwise the largest is kept. The selection is immediate; with an executor, everything else runs
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
        self._coverage = Coverage(settings.memory_px)
        self._reference = 0

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
        return registered.reference != self._reference and registered.change is None

    def add(
        self,
        registered: FrameRegistration,
        shape: tuple[int, int],
        load: Callable[[], ImageArray],
        position: GeodeticPoint | None = None,
    ) -> bool:
        """Adds a registered frame where the mosaic needs it; whether the mosaic changes.

        A frame of a new plane starts another mosaic: `finish` the previous one first. `load` returns the
        pixels and is called only for frames that are added.

        Raises:
            OSError: a temporary file is full.
        """
        if self.is_new_plane(registered):
            self._new_coverage()
            self._do(partial(self._begin_plane, registered.reference))
        elif registered.rebase is not None:
            self._coverage.move_plane(registered.rebase)
            self._do(partial(self.frames.rebase, registered.rebase, registered.reference))
        self._reference = registered.reference
        if not registered.anchored:
            return False
        new_ground = self._coverage.uncovered(shape, registered.to_reference) > _MIN_NEW_GROUND
        if not (registered.keyframe or new_ground):
            return False
        if not self._coverage.add(shape, registered.to_reference):
            self.refused += 1
            return False
        work = partial(self.frames.add, registered, shape, load, position)
        self._do(work, shape[0] * shape[1] * _BYTES_PER_PIXEL)
        return True

    def save(self) -> None:
        """Writes the current mosaic as painted so far, and goes on with it; see `MosaicFrames.save`."""
        self._do(partial(self.frames.save, self._coverage.covered_px))

    def start_writing(
        self,
        adjust: Callable[[], AdjustedHomographies],
        written: Callable[[WrittenMosaic], None] = lambda _: None,
    ) -> "Future[None]":
        """Writes the current mosaic after everything added before, and starts another.

        `adjust` returns the adjusted homographies of the keyframes; `written` is called with the result,
        unless there is nothing or a larger one was written before. The future is done when the file is; it
        has an OSError where it could not be written.
        """
        work = partial(
            self._write, self._coverage.covered_px, self.is_empty, self._reference, adjust, written
        )
        self._new_coverage()
        if self._executor is not None:
            return self._executor.ask(work)
        future: Future[None] = Future()
        try:
            future.set_result(work())
        except Exception as error:
            future.set_exception(error)
        return future

    def finish(
        self, homographies: Mapping[int, FloatArray] | None = None, rmse: float = 0.0
    ) -> WrittenMosaic | None:
        """Writes the current mosaic and waits for it, see `start_writing` and `MosaicFrames.write`.

        Raises:
            OSError: it could not be written.
        """
        results: list[WrittenMosaic] = []
        self.start_writing(lambda: (homographies, rmse), results.append).result()
        return results[0] if results else None

    def close(self) -> None:
        """Releases everything that was not written; the executor must have ended."""
        self.frames.close()
        self._coverage.close()

    def _do(self, work: Callable[[], object], size: int = 0) -> None:
        if self._executor is None:
            work()
        else:
            self._executor.do(work, size, self._cancelled)

    def _new_coverage(self) -> None:
        self._coverage.close()
        self._coverage = Coverage(self._settings.memory_px)

    def _begin_plane(self, reference: int) -> None:
        self.frames.close()
        self.frames.begin_plane(reference)

    def _write(
        self,
        covered_px: float,
        is_empty: bool,
        reference: int,
        adjust: Callable[[], AdjustedHomographies],
        written: Callable[[WrittenMosaic], None],
    ) -> None:
        try:
            adjusted = adjust()
            result = None if is_empty else self.frames.write(covered_px, *adjusted)
        finally:
            self._begin_plane(reference)
        if result is not None:
            written(result)
