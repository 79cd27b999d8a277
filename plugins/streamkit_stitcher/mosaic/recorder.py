"""Which pictures go into a mosaic, and when a mosaic is finished."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from threading import Event
from typing import Final

from streamkit.geometry.homography import FloatArray
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.mosaic.album import Album, ChosenPicture, RecorderSettings, WrittenMosaic
from streamkit_stitcher.mosaic.coverage import Coverage
from streamkit_stitcher.mosaic.georeference import PositionFix
from streamkit_stitcher.mosaic.mosaic import Mosaic
from streamkit_stitcher.mosaic.tiles import PictureArray
from streamkit_stitcher.plane.placement import Placement

_WORTH_ADDING: Final = 0.08
_BYTES_PER_PIXEL: Final = 3

AdjustedPlaces = tuple[Mapping[int, FloatArray] | None, float]


class MosaicRecorder:
    """Keeps the mosaic of the current plane and writes those that are finished.

    Key pictures go in, and pictures that show ground not seen before; a picture whose place was not measured
    never does. With `%d` in the location each plane gets a file; otherwise the one that covers most is kept.

    What goes in is decided at once. Given a worker, all else is done by it, in the same order, so that the
    mosaic is the same; what `mosaic` gives is then the worker's.

    Args:
        settings: how.
        worker: keeps, paints and writes beside the caller; None has the caller do it.
        cancelled: ends waits for a worker that has too much to do.
    """

    def __init__(
        self,
        settings: RecorderSettings,
        worker: BackgroundExecutor | None = None,
        cancelled: Event | None = None,
    ) -> None:
        self._settings = settings
        self._worker = worker
        self._cancelled = cancelled
        self.album = Album(settings) if worker is None else Album(settings, worker.report_progress)
        self._refused = 0
        self._ground = Coverage(settings.memory_px)
        self._reference = 0

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
        return self.album.mosaic

    def is_other_plane(self, placement: Placement) -> bool:
        """Whether a picture lies on a plane that cannot be drawn on with the mosaic's."""
        return placement.opens or (placement.reference != self._reference and placement.change is None)

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
            Whether the mosaic changes.

        Raises:
            OSError: a temporary file takes no more.
        """
        if self.is_other_plane(placement):
            self._begin(placement.reference)
        elif placement.exchange is not None:
            self._ground.move_plane(placement.exchange)
            self._do(partial(self.album.follow, placement.exchange, placement.reference))
        self._reference = placement.reference
        if not placement.anchored or not (placement.keyframe or self._is_new_ground(shape, placement)):
            return False
        if not self._ground.add(shape, placement.to_reference):
            self._refused += 1
            return False
        chosen = ChosenPicture(
            shape,
            placement.to_reference,
            not placement.keyframe,
            placement.key_index,
            placement.to_key,
            position,
        )
        self._do(partial(self.album.add, chosen, picture), shape[0] * shape[1] * _BYTES_PER_PIXEL)
        return True

    def leave(
        self, adjust: Callable[[], AdjustedPlaces], done: Callable[[WrittenMosaic], None] = lambda _: None
    ) -> "Future[None]":
        """Has the current mosaic written, once all that was added is in it, and begins anew.

        Args:
            adjust: gives the adjusted places of the key pictures by their numbers, None for the mosaic as it
                grew, and the root mean square residual of the tie points, px.
            done: told what was written; not called where there is nothing, or a larger one was written
                before.

        Returns:
            Done when the file is; has an OSError where it could not be written.
        """
        work = partial(self._write, self._ground.covered_px, self.is_empty, self._reference, adjust, done)
        self._ground.close()
        self._ground = Coverage(self._settings.memory_px)
        if self._worker is not None:
            return self._worker.ask(work)
        future: Future[None] = Future()
        try:
            future.set_result(work())
        except Exception as error:
            future.set_exception(error)
        return future

    def finish(
        self, places: Mapping[int, FloatArray] | None = None, rmse: float = 0.0
    ) -> WrittenMosaic | None:
        """Writes the current mosaic, once, and waits for it: see `leave`, `Album.write`.

        Raises:
            OSError: it could not be written.
        """
        written: list[WrittenMosaic] = []
        self.leave(lambda: (places, rmse), written.append).result()
        return written[0] if written else None

    def close(self) -> None:
        """Lets go of everything that was not written; the worker must have ended."""
        self.album.close()
        self._ground.close()

    def _do(self, work: Callable[[], object], size: int = 0) -> None:
        if self._worker is None:
            work()
        else:
            self._worker.do(work, size, self._cancelled)

    def _begin(self, reference: int) -> None:
        self._reference = reference
        self._ground.close()
        self._ground = Coverage(self._settings.memory_px)
        self._do(partial(self._begin_album, reference))

    def _begin_album(self, reference: int) -> None:
        self.album.close()
        self.album.begin(reference)

    def _write(
        self,
        covered_px: float,
        is_empty: bool,
        reference: int,
        adjust: Callable[[], AdjustedPlaces],
        done: Callable[[WrittenMosaic], None],
    ) -> None:
        try:
            adjusted = adjust()
            written = None if is_empty else self.album.write(covered_px, *adjusted)
        finally:
            self._begin_album(reference)
        if written is not None:
            done(written)

    def _is_new_ground(self, shape: tuple[int, int], placement: Placement) -> bool:
        return self._ground.uncovered(shape, placement.to_reference) > _WORTH_ADDING
