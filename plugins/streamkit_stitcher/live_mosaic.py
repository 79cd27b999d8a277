"""The mosaic of a running stream: painted and written in the background, shown through a pad."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import asdict
from functools import partial
from typing import Final

import cv2
import numpy as np

from streamkit import SECOND_NS, Caps, Frame, HiddenPixels, Pad, Registration, Transform, luma
from streamkit.geometry.homography import inverse
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.mosaic.frame_views import Position
from streamkit_stitcher.mosaic.image_file import is_tiff
from streamkit_stitcher.mosaic.mosaic_frames import AdjustedPlanes, WrittenMosaic
from streamkit_stitcher.mosaic.recorder import MosaicRecorder
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.mosaic_pad import MosaicPad
from streamkit_stitcher.plane.frame_registration import FrameRegistration
from streamkit_stitcher.plane.keyframe_map import KeyframeMap

PREVIEW_CAPS = Caps("video/x-raw, format={ BGR, I420, GRAY8 }, width=[ 16, 8192 ], height=[ 16, 8192 ]")
_DEFAULT_SIZE = Caps("video/x-raw, width=1280, height=720")
_TO_BGR = {"I420": cv2.COLOR_YUV2BGR_I420, "NV12": cv2.COLOR_YUV2BGR_NV12}
_FROM_BGR = {"I420": cv2.COLOR_BGR2YUV_I420, "GRAY8": cv2.COLOR_BGR2GRAY}
_MAX_QUEUED_BYTES: Final = 128_000_000
_PROGRESS_LIMIT_S: Final = 120.0
_CLOSE_LIMIT_S: Final = 5.0


class LiveMosaic:
    """Hands the frames of a mosaic to a background thread.

    The thread converts and paints queued frames. With 128 MB queued the stream waits, so that no frame is
    dropped and the same frames give the same mosaic.

    Args:
        element: posts messages and has the pad `mosaic`.
        settings: how mosaics are made.
        interval_s: least time between two frames of the pad.
        mosaic_pad: returns the sender of the pad, of which each run has another.

    Attributes:
        recorder: selects the frames.
    """

    def __init__(
        self,
        element: Transform,
        settings: RecorderSettings,
        interval_s: float,
        mosaic_pad: Callable[[], MosaicPad],
    ) -> None:
        self._element = element
        self._settings = settings
        self._interval_ns = round(interval_s * SECOND_NS)
        self._mosaic_pad = mosaic_pad
        self._executor = BackgroundExecutor(
            f"{element.name} mosaic", self._failed, max_bytes=_MAX_QUEUED_BYTES
        )
        self.recorder = MosaicRecorder(settings, self._run, self._executor.report_progress)
        self._failure: Exception | None = None
        self._writing: Future[None] | None = None
        self._largest: WrittenMosaic | None = None
        self._save_due_s = time.monotonic() + settings.save_interval
        self._epoch: int | None = None
        self._preview_pts = 0
        self._has_changed = self._is_preview_queued = False
        self._caps: Caps | None = None

    def _run(self, work: Callable[[], object], size: int = 0) -> None:
        self._executor.submit_waiting(work, size, self._element.stopping)

    def end_plane(self, closed: KeyframeMap | None) -> None:
        """Writes the planes that ended for good; others wait until the end, as they may be joined."""
        if closed is not None or not self.recorder.keeps_planes:
            self._write(closed).add_done_callback(self._plane_written)

    def record(
        self, frame: Frame, registered: FrameRegistration, shape: tuple[int, int], position: Position
    ) -> None:
        """Adds a keyframe or a frame that shows new ground; the background thread converts its pixels.

        Raises:
            Exception: a failure of the background thread other than of the disk.
        """
        if self._failure is not None:
            raise self._failure
        if (hidden := frame.get(HiddenPixels)) is not None:
            self.recorder.frames.graphics.given = hidden.mask
        refused = self.recorder.refused
        self._has_changed |= self.recorder.add(registered, shape, partial(mosaic_image, frame), position)
        if self.recorder.refused and not refused:
            self._element.post_warning(
                f"{frame.describe()} does not fit into the mosaic and is left out, as others may be; check "
                "the registration"
            )
        if self._settings.save_interval and time.monotonic() >= self._save_due_s:
            self._save_due_s = math.inf
            self.recorder.save()
            self._run(self._saved)
        pts = frame.pts or 0
        if frame.epoch != self._epoch:
            self._epoch, self._preview_pts = frame.epoch, min(pts, self._preview_pts)
        is_due = self._has_changed and pts - self._preview_pts >= self._interval_ns
        if is_due and not self._is_preview_queued and linked_pad(self._element) is not None:
            self._preview_pts, self._has_changed, self._is_preview_queued = pts, False, True
            self._run(partial(self._show, frame.pts, self._element.flushes))

    def _write(self, plane: KeyframeMap | None) -> Future[None]:
        """Writes the mosaics so far while the stream continues."""
        writing = self._executor.submit(self.recorder.writing(partial(self._adjusted, plane), self._announce))
        if plane is not None:
            writing.add_done_callback(lambda _: plane.close())
        return writing

    def show_last(self) -> None:
        """Shows the mosaic in its last state."""
        if not self.recorder.is_empty:
            self._run(partial(self._show, None, self._element.flushes))

    def finish(self, plane: KeyframeMap | None, stopping: threading.Event | None = None) -> bool:
        """Writes the mosaic of the current plane, and waits for it; returns whether it is done.

        `stopping` ends the wait; call again to continue it.

        Raises:
            OSError: the mosaic could not be written, or there was no progress for two minutes.
            Exception: a failure of the background thread while the pipeline plays.
        """
        if self._writing is None:
            self._writing = self._write(plane)
        if not self._executor.wait(self._writing, _PROGRESS_LIMIT_S, stopping):
            if stopping is not None and stopping.is_set():
                return False
            raise OSError(f"no progress for {_PROGRESS_LIMIT_S:g} s")
        writing, self._writing = self._writing, None
        writing.result()
        if self._failure is not None and stopping is not None:
            raise self._failure
        return True

    def close(self) -> None:
        """Ends the background thread; queued work is dropped."""
        if self._executor.close(_CLOSE_LIMIT_S):
            self.recorder.close()

    @property
    def summary(self) -> dict[str, object]:
        """What the message `summary` says of the mosaic of the most frames."""
        largest = self._largest
        if largest is None:
            return {}
        names = "width", "height", "pictures", "ground_resolution_m", "geo_error_m", "geo_refused"
        return {"file": str(largest.path), **{name: getattr(largest, name) for name in names}}

    # In the background thread.

    def _show(self, pts: int | None, flushes: int) -> None:
        """Queues a preview for the pad, unless a flush began since."""
        self._is_preview_queued = False
        pad = linked_pad(self._element)
        if pad is None or flushes != self._element.flushes:
            return
        if self._caps is None:
            self._caps = (pad.peer_caps() & PREVIEW_CAPS).fixate(near=_DEFAULT_SIZE)
        caps, frames = self._caps, self.recorder.frames
        image, from_plane = frames.mosaic.preview(caps.integer("width"), caps.integer("height"))
        registration = Registration(np.eye(3), inverse(from_plane), reference=frames.reference)
        frame = Frame(
            _in_format(image, str(caps["format"])), caps, pts=self._preview_pts if pts is None else pts
        )
        self._mosaic_pad().put(frame.attach(registration))

    def _saved(self) -> None:
        self._save_due_s = time.monotonic() + self._settings.save_interval

    def _adjusted(self, plane: KeyframeMap | None, focal_px: float) -> AdjustedPlanes:
        if plane is None or not self._settings.final:
            return {}, 0.0
        rmse = plane.finish(focal_px)
        return plane.planes, rmse

    def _plane_written(self, writing: Future[None]) -> None:
        error = None if writing.cancelled() else writing.exception()
        if isinstance(error, Exception):
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        """A lost mosaic is a warning, as the stream matters more; other failures end the stream."""
        if isinstance(error, OSError):
            self._element.post_warning(f"the mosaic, or that of an earlier plane, is lost: {error}")
        else:
            self._failure = error

    def _announce(self, written: WrittenMosaic) -> None:
        if written.geo_refused and is_tiff(written.path.name):
            self._element.post_warning(f"{written.path} is not georeferenced: {written.geo_refused}")
        if self._largest is None or written.pictures >= self._largest.pictures:
            self._largest = written
        path, paths = str(written.path), self._element.written_paths
        if path not in paths:
            self._element.written_paths = (*paths[:1], path)
        counts = self._element.outcomes
        weak, lost = counts[RegistrationStatus.WEAK], counts[RegistrationStatus.LOST]
        placed = counts.total() - weak - lost
        fields = {**asdict(written), "path": path, "placed": placed, "weak": weak, "lost": lost}
        self._element.post_message("mosaic", **fields)


def linked_pad(element: Transform) -> Pad | None:
    """The element's pad `mosaic`, or None while it is not linked."""
    pad = element.pads.get("mosaic")
    return pad if pad is not None and pad.peer is not None else None


def _in_format(image: ImageArray, pixel_format: str) -> ImageArray:
    """Converts uint8[h, w, c] to a pixel format."""
    bgr = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)) if image.shape[2] == 1 else image
    code = _FROM_BGR.get(pixel_format)
    return np.asarray(bgr if code is None else cv2.cvtColor(bgr, code), dtype=np.uint8)


def mosaic_image(frame: Frame) -> ImageArray:
    """The frame's pixels for the mosaic: BGR uint8[h, w, 3], or uint8[h, w] of a grey frame."""
    pixel_format = str(frame.caps["format"])
    code = _TO_BGR.get(pixel_format)
    if code is None:
        return np.asarray(frame.data, dtype=np.uint8) if pixel_format == "BGR" else luma(frame)
    return np.asarray(cv2.cvtColor(frame.data, code), dtype=np.uint8)
