"""stitch: places each frame on the ground plane, and writes the mosaic of what was seen."""

from __future__ import annotations

import enum
from dataclasses import asdict

import cv2
import numpy as np

from streamkit import (
    LUMA_CAPS,
    Frame,
    FrameFlags,
    Property,
    Registration,
    RegistrationStatus,
    ResourceError,
    Transform,
    luma,
)
from streamkit_stitcher.mosaic.canvas import PictureArray
from streamkit_stitcher.mosaic.picture_file import check_location
from streamkit_stitcher.mosaic.recorder import MosaicRecorder, WrittenMosaic
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.plane.tracker import Placement, PlaneTracker
from streamkit_stitcher.registration.motion_models import FitLimits

_TO_BGR = {"I420": cv2.COLOR_YUV2BGR_I420, "NV12": cv2.COLOR_YUV2BGR_NV12}


class ReferencePlane(enum.StrEnum):
    """The plane that frames are placed on."""

    FIRST = "first"


class Stitch(Transform):
    """Attaches to each frame where it lies on the ground plane, and joins the frames to a mosaic.

    Pixels pass untouched. A frame that cannot be placed passes too, marked `lost`, with the camera's last
    motion carried on. After a cut, a new epoch or a new frame size the plane has another number and status
    `cut`. The mosaic is written at EOS, or when the pipeline stops before; a message `mosaic` tells its size.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! fakesink
    """

    sink = src = LUMA_CAPS
    location: str | None = Property(
        None,
        doc="Path of the mosaic, .png or .jpg; %d in it gives each plane a file, else the largest is kept.",
    )
    reference: ReferencePlane = Property(
        ReferencePlane.FIRST, doc="Plane of the placements: that of the first usable frame."
    )
    registration_width: int = Property(
        640, min=64, max=4096, unit="px", doc="Frames are halved to this width or less to follow the motion."
    )
    max_points: int = Property(
        220, min=20, max=2000, doc="Corners followed from frame to frame; more is slower and steadier."
    )
    ransac_threshold: float = Property(
        1.0, min=0.1, max=20.0, unit="px at registration width", doc="Largest residual of an inlier."
    )
    min_inliers: int = Property(
        20, min=8, max=1000, doc="Fewest points that must agree on a homography; simpler motions need fewer."
    )
    min_inlier_ratio: float = Property(
        0.35, min=0.05, max=1.0, doc="Least share of the matched points that must agree on the motion."
    )
    keyframe_overlap: float = Property(
        0.65, min=0.3, max=0.95, doc="A frame that shares less than this with its key frame becomes one."
    )
    max_canvas_mpx: float = Property(
        64.0, min=1.0, max=1024.0, unit="Mpx", doc="Size at which the mosaic halves its resolution."
    )

    def start(self) -> None:
        """Begins without a plane; refuses a location that could not be written at the end."""
        self._tracker = PlaneTracker(self._settings())
        self._recorder: MosaicRecorder | None = None
        self._epoch: int | None = None
        if self.location is None:
            return
        try:
            check_location(self.location)
        except OSError as error:
            raise ResourceError(f"{self.name}: {error}") from error
        self._recorder = MosaicRecorder(self.location, round(self.max_canvas_mpx * 1e6))

    def transform(self, frame: Frame) -> Frame:
        """Attaches Registration to the frame and lays it into the mosaic where it shows new ground."""
        if self._epoch is not None and frame.epoch != self._epoch:
            self._tracker.restart()
        self._epoch = frame.epoch
        if frame.flags & FrameFlags.CORRUPT:
            return frame.attach(registration(self._tracker.skip()))
        grey = luma(frame)
        placement = self._tracker.place(grey)
        if self._recorder is not None:
            self._record(self._recorder, placement, frame, (grey.shape[0], grey.shape[1]))
        return frame.attach(registration(placement))

    def drain(self) -> tuple[()]:
        """Writes the mosaic.

        Raises:
            ResourceError: it cannot be written.
        """
        try:
            self._finish()
        except OSError as error:
            raise ResourceError(f"{self.name}: the mosaic is lost: {error}") from error
        return ()

    def stop(self) -> None:
        """Writes the mosaic if EOS did not come, and lets go of it."""
        try:
            self._finish()
        except OSError as error:
            self.post_warning(f"the mosaic is lost: {error}")
        self._recorder = None
        self._tracker.restart()

    def _settings(self) -> PlaneSettings:
        limits = FitLimits(
            threshold=self.ransac_threshold, min_inliers=self.min_inliers, min_ratio=self.min_inlier_ratio
        )
        return PlaneSettings(
            working_width=self.registration_width,
            max_points=self.max_points,
            limits=limits,
            keyframe_overlap=self.keyframe_overlap,
        )

    def _record(
        self, recorder: MosaicRecorder, placement: Placement, frame: Frame, shape: tuple[int, int]
    ) -> None:
        refused = recorder.refused
        try:
            self._announce(recorder.add(placement, shape, lambda: picture_of(frame)))
        except OSError as error:
            # The frames matter more than a picture of an earlier plane: the stream goes on.
            self.post_warning(f"the mosaic of an earlier plane is lost: {error}")
        if recorder.refused and not refused:
            self.post_warning(
                f"{frame.describe()} does not fit into the mosaic of {self.max_canvas_mpx} Mpx and is left "
                "out, as others may be; raise max-canvas-mpx, or see whether the registration holds"
            )

    def _finish(self) -> None:
        if self._recorder is not None:
            self._announce(self._recorder.finish())

    def _announce(self, written: WrittenMosaic | None) -> None:
        if written is not None:
            self.post_message("mosaic", **{**asdict(written), "path": str(written.path)})


def registration(placement: Placement) -> Registration:
    """A placement as metadata."""
    return Registration(
        placement.to_previous,
        placement.to_reference,
        reference=placement.reference,
        status=RegistrationStatus(placement.status.value),
        keyframe=placement.keyframe,
        matches=placement.matches,
        inliers=placement.inliers,
        rmse=placement.rmse,
    )


def picture_of(frame: Frame) -> PictureArray:
    """A frame for the mosaic: uint8[h, w, 3] BGR where it has colour, else its brightness uint8[h, w]."""
    code = _TO_BGR.get(str(frame.caps["format"]))
    if code is None:
        return luma(frame)
    return np.asarray(cv2.cvtColor(frame.data, code), dtype=np.uint8)
