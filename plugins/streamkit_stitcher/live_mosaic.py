"""The mosaic beside the stream: painted and written by a worker, shown through a pad."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import asdict
from functools import partial
from typing import Any, Final

import cv2
import numpy as np

from streamkit import Caps, Frame, Registration, Transform
from streamkit.geometry.homography import inverse
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.mosaic.album import RecorderSettings, WrittenMosaic
from streamkit_stitcher.mosaic.georeference import PositionFix
from streamkit_stitcher.mosaic.recorder import AdjustedPlaces, MosaicRecorder
from streamkit_stitcher.mosaic.tiles import PictureArray
from streamkit_stitcher.mosaic_pad import MosaicPad
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.placement import Placement

PREVIEW_CAPS = Caps("video/x-raw, format={ BGR, I420, GRAY8 }, width=[ 16, 8192 ], height=[ 16, 8192 ]")
_PREVIEW = Caps("video/x-raw, width=1280, height=720")
_FROM_BGR = {"I420": cv2.COLOR_BGR2YUV_I420, "GRAY8": cv2.COLOR_BGR2GRAY}
_NS = 1_000_000_000
_WAITING_BYTES: Final = 128_000_000
_PATIENCE_S: Final = 120.0
_LEAVE_S: Final = 5.0


class LiveMosaic:
    """Takes the frames of a stream that are worth it, and never holds the stream up for what follows.

    A frame waits as it is until the worker paints it; with 128 MB of them waiting the stream waits, too, so
    that every one gets into the mosaic and the same frames give the same mosaic.

    Args:
        element: posts messages and has the pad `mosaic`.
        settings: how mosaics are made.
        interval_s: least time between two pictures of the pad.
        shown: gives what the pad's pictures are handed to.
    """

    def __init__(
        self,
        element: Transform,
        settings: RecorderSettings,
        interval_s: float,
        shown: Callable[[], MosaicPad],
    ) -> None:
        self._element = element
        self._interval_ns = round(interval_s * _NS)
        self._shown = shown
        self._worker = BackgroundExecutor(f"{element.name} mosaic", _WAITING_BYTES, self._failed)
        self._recorder = MosaicRecorder(settings, self._worker, element.stopping)
        self._adjusts = settings.final
        self._failure: Exception | None = None
        self._writing: Future[None] | None = None
        self._epoch: int | None = None
        self._shown_pts = 0
        self._is_due = self._is_waiting = False
        self._caps: Caps | None = None

    def is_other_plane(self, placement: Placement) -> bool:
        """Whether a frame lies on a plane that nothing relates to the mosaic's: `leave` that one first."""
        return self._recorder.is_other_plane(placement)

    def record(
        self,
        frame: Frame,
        placement: Placement,
        shape: tuple[int, int],
        picture: Callable[[], PictureArray],
        position: PositionFix | None,
    ) -> None:
        """Takes a frame where it is a key frame or shows new ground; `picture` is called by the worker.

        Raises:
            Exception: what the worker met before, if that was no failure of the disk.
        """
        if self._failure is not None:
            raise self._failure
        refused = self._recorder.refused
        self._is_due |= self._recorder.add(placement, shape, picture, position)
        if self._recorder.refused and not refused:
            self._element.post_warning(
                f"{frame.describe()} does not fit into the mosaic and is left out, as others may be; see "
                "whether the registration holds"
            )
        pts = frame.pts or 0
        if frame.epoch != self._epoch:
            self._epoch, self._shown_pts = frame.epoch, min(pts, self._shown_pts)
        is_due = self._is_due and not self._is_waiting and pts - self._shown_pts >= self._interval_ns
        if is_due and linked_pad(self._element) is not None:
            self._shown_pts, self._is_due, self._is_waiting = pts, False, True
            self._worker.do(partial(self._show, frame.pts, self._element.flushes))

    def leave(self, plane: KeyframeMap | None) -> None:
        """Has the mosaic of a plane that was left written; the stream goes on meanwhile."""
        writing = self._recorder.leave(partial(self._adjusted, plane), self._announce)
        writing.add_done_callback(lambda done: self._left(plane, done))

    def show_last(self) -> None:
        """Has the mosaic shown once more, as it is in the end."""
        if not self._recorder.is_empty:
            self._worker.do(partial(self._show, None, self._element.flushes))

    def finish(self, plane: KeyframeMap | None, stopping: threading.Event | None = None) -> bool:
        """Has the mosaic of the current plane written, and waits for it.

        Args:
            plane: its key pictures.
            stopping: ends the wait; to go on waiting call again.

        Returns:
            Whether it is done.

        Raises:
            OSError: the mosaic could not be written, or nothing has come of it for two minutes.
            Exception: what the worker met before, while the pipeline plays.
        """
        if self._writing is None:
            self._writing = self._recorder.leave(partial(self._adjusted, plane), self._announce)
            if plane is not None:
                self._writing.add_done_callback(lambda _: plane.close())
        if not self._worker.wait(self._writing, _PATIENCE_S, stopping):
            if stopping is not None and stopping.is_set():
                return False
            raise OSError(f"nothing has come of it for {_PATIENCE_S:g} s")
        writing, self._writing = self._writing, None
        writing.result()
        if self._failure is not None and stopping is not None:
            raise self._failure
        return True

    def close(self) -> None:
        """Ends the worker, with what it has not done."""
        if self._worker.close(_LEAVE_S):
            self._recorder.close()

    def _show(self, pts: int | None, flushes: int) -> None:
        """In the worker's thread: lines the mosaic up as it is, unless a flush came in between."""
        self._is_waiting = False
        pad = linked_pad(self._element)
        if pad is None or flushes != self._element.flushes:
            return
        if self._caps is None:
            self._caps = (pad.peer_caps() & PREVIEW_CAPS).fixate(near=_PREVIEW)
        caps, album = self._caps, self._recorder.album
        picture, matrix = album.mosaic.canvas.preview(caps.integer("width"), caps.integer("height"))
        place = Registration(np.eye(3), inverse(matrix), reference=album.reference)
        data = _in_format(picture, str(caps["format"]))
        self._shown().put(Frame(data, caps, pts=self._shown_pts if pts is None else pts).attach(place))

    def _adjusted(self, plane: KeyframeMap | None) -> AdjustedPlaces:
        if plane is None or not self._adjusts:
            return None, 0.0
        rmse = plane.finish()
        return dict(plane.places), rmse

    def _left(self, plane: KeyframeMap | None, writing: Future[None]) -> None:
        """The mosaic of an earlier plane was written, or not; nobody waits for it."""
        if plane is not None:
            plane.close()
        error = None if writing.cancelled() else writing.exception()
        if isinstance(error, Exception):
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        """In the worker's thread: the frames matter more than a picture of them, so the stream goes on."""
        if isinstance(error, OSError):
            self._element.post_warning(f"the mosaic, or that of an earlier plane, is lost: {error}")
        else:
            self._failure = error

    def _announce(self, written: WrittenMosaic) -> None:
        self._element.post_message("mosaic", **{**asdict(written), "path": str(written.path)})


def linked_pad(element: Transform) -> Any:
    """The element's pad `mosaic`, or None while nobody is there to look at it."""
    pad = element.pads.get("mosaic")
    return pad if pad is not None and pad.peer is not None and not pad.is_eos else None


def _in_format(picture: PictureArray, pixel_format: str) -> PictureArray:
    """uint8[h, w, c] in a pixel format."""
    colours = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)) if picture.shape[2] == 1 else picture
    code = _FROM_BGR.get(pixel_format)
    return np.asarray(colours if code is None else cv2.cvtColor(colours, code), dtype=np.uint8)
