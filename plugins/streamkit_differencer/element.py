"""framediff: detects moving objects in each frame, on the ground plane that the registration gives."""

from __future__ import annotations

import enum
from fractions import Fraction
from typing import ClassVar

import numpy as np
from typing_extensions import override

from streamkit import (
    LUMA_CAPS,
    Caps,
    Detections,
    Direction,
    Frame,
    FrameFlags,
    HiddenPixels,
    PadTemplate,
    Presence,
    Property,
    PropertyError,
    Registration,
    RegistrationStatus,
    ResourceError,
    SettingsOf,
    Transform,
    luma,
    raw_video_caps,
)
from streamkit_differencer.canvas import CanvasChange, Motion
from streamkit_differencer.differencer import Differencer, ModelChange, Result, warm_up
from streamkit_differencer.foreground import full_size
from streamkit_differencer.objects import NO_OBJECTS
from streamkit_differencer.region import region_mask
from streamkit_differencer.settings import DifferencerSettings
from streamkit_kernels import start_kernels

WORKING_SCALES = (0, 1, 2, 4)
MASK_CAPS = Caps("video/x-raw, format=GRAY8")
# Labels of detections.
MOVING, STOPPED = "moving", "stopped"
WEAK_REGISTRATION = 0.5
# Residual of a registration that is worth half, px.
POOR_RMSE_PX = 4.0


class MotionSource(enum.StrEnum):
    """Where the camera's motion is taken from."""

    AUTO = "auto"
    METADATA = "metadata"
    OWN = "own"
    NONE = "none"


class FrameDiff(Transform):
    """Attaches a detection for every moving object: what differs from a background that it learns.

    A camera that flies needs `stitch` upstream; for one that is fixed, shakes or turns slowly framediff
    measures the motion itself. The background of a piece of ground is known half a second after it came
    into view. Until then an earlier frame takes its place, and an object in it that moves away leaves a
    ghost; behind `stitch`, only known background counts in the first second.
    The score of a detection combines its contrast, its age in frames and the quality of the frame's
    registration. An object that has stopped is reported with `stopped=true`, until it is background. A frame
    that is corrupt or whose registration is lost gets no detections and does not update the background.

    The pad `mask` carries the foreground mask: 255 moving, 128 stopped, 50 shadow, 0 background.
    Messages `model` report when the background starts from scratch (`new`; `reset` after a cut), moved to
    another canvas (`reanchor`), adapted to a change of exposure (`gain`), held because frames cannot be
    registered or may show another scene (`held`) and updated again (`resumed`); messages `crowded` report
    frames with more than `max-objects`.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! fakesink
    """

    sink = src = LUMA_CAPS
    templates: ClassVar = (PadTemplate("mask", Direction.SRC, MASK_CAPS, Presence.REQUEST),)
    motion: MotionSource = Property(
        MotionSource.AUTO,
        doc="Source of the camera motion: metadata is that of stitch, own is measured here, none is a fixed "
        "camera; auto takes metadata where frames have it, else own.",
    )
    roi: str = Property(
        "",
        doc="Region of interest: polygons '0,0 640,0 640,200; ...' in px or shares of the frame, or an image "
        "that is white inside; everywhere if empty.",
    )
    min_score: float = Property(0.0, min=0.0, max=1.0, live=True, doc="Smallest score reported.")
    settings = SettingsOf(DifferencerSettings)

    def start(self) -> None:
        """Starts without a model.

        Raises:
            PropertyError: working-scale is none of 0, 1, 2 and 4.
            ResourceError: roi cannot be read.
        """
        scale = self.settings.working_scale
        if scale not in WORKING_SCALES:
            raise PropertyError(
                f"{self.name}: property working-scale must be 0, 1, 2 or 4, got {scale}; "
                "use 0 to go by the frame's width"
            )
        try:
            region_mask(self.roi or "0,0 1,0 1,1", 1, 1)
        except ValueError as error:
            raise ResourceError(f"{self.name}: roi: {error}") from error
        start_kernels("streamkit_differencer", warm_up, is_live=self.query_live(), report=self.post_warning)
        self._differencer = Differencer(own_motion=self.motion in (MotionSource.AUTO, MotionSource.OWN))
        self._crowded = self._is_held = False
        self._last_event = ModelChange.NONE

    @override
    def wants_upstream(self) -> tuple[str, ...]:
        return ("stitch",) if self.motion in (MotionSource.AUTO, MotionSource.METADATA) else ()

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        width, height = sink_caps.integer("width"), sink_caps.integer("height")
        self._differencer.region = region_mask(self.roi, width, height) if self.roi else None
        rate = sink_caps.get("framerate", None)
        self._mask_caps = raw_video_caps("GRAY8", width, height, rate if isinstance(rate, Fraction) else None)

    @override
    def transform(self, frame: Frame) -> Frame | tuple[tuple[str, Frame], Frame]:
        uses_metadata = self.motion in (MotionSource.AUTO, MotionSource.METADATA)
        registration = frame.get(Registration) if uses_metadata else None
        result = self._update(frame, registration)
        self._report(result)
        found = result.objects if result else NO_OBJECTS
        kept = found.confidences >= self.min_score
        rows = found.centroids[kept], found.boxes[kept], found.areas[kept], found.confidences[kept]
        has_stopped = found.changes[kept] < self.settings.objects.min_change
        labels = np.where(has_stopped, STOPPED, MOVING).tolist() if self.settings.objects.stopped else ()
        passed = frame.attach(Detections(*rows, labels=tuple(labels)))
        if "mask" not in self.pads:
            return passed
        height, width = luma(frame).shape
        mask = full_size(result.foreground if result else None, width, height)
        return ("mask", passed.replace(data=mask, caps=self._mask_caps)), passed

    def _update(self, frame: Frame, registration: Registration | None) -> Result | None:
        is_lost = registration is not None and registration.status == RegistrationStatus.LOST
        if is_lost or frame.flags & FrameFlags.CORRUPT:
            return None
        if registration is not None and registration.status == RegistrationStatus.CUT:
            self._differencer.reset()
        hidden = frame.get(HiddenPixels)
        self._differencer.settings = self.settings
        self._differencer.hidden = None if hidden is None else hidden.mask
        return self._differencer.update(luma(frame), motion_of(registration))

    def _report(self, result: Result | None) -> None:
        """Posts what changed with this frame."""
        if (result is None) != self._is_held:
            self._is_held = result is None
            self.post_message("model", event="held" if self._is_held else "resumed")
        if result is None:
            return
        begins_to_follow = result.event is ModelChange.GAIN and self._last_event is ModelChange.NONE
        if result.event is ModelChange.RESET or begins_to_follow:
            self.post_message("model", event=str(result.event))
        elif result.change in (CanvasChange.NEW, CanvasChange.REANCHOR):
            self.post_message("model", event=str(result.change))
        self._last_event = result.event
        dropped = result.objects.dropped
        if dropped and not self._crowded:
            self.post_message("crowded", found=len(result.objects) + dropped, kept=len(result.objects))
        if dropped:
            self.warn_once(
                f"{len(result.objects) + dropped} detections in a frame, more than "
                f"max-objects={self.settings.objects.max_objects}; those with the lowest scores are dropped: "
                "raise max-objects, or foreground-threshold or min-area if they are noise",
                code="max-objects",
            )
        self._crowded = bool(dropped)


def motion_of(registration: Registration | None) -> Motion | None:
    """A frame's registration as the differencer takes it; None where the frame has none."""
    if registration is None:
        return None
    is_weak = registration.status == RegistrationStatus.WEAK
    return Motion(
        registration.to_reference,
        registration.reference,
        registration.reference_change,
        WEAK_REGISTRATION if is_weak else 1.0 / (1.0 + registration.rmse / POOR_RMSE_PX),
    )
