"""stitch: places each frame on the ground plane, and joins the frames to a mosaic."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from fractions import Fraction
from functools import partial
from typing import Any, ClassVar

import cv2
import numpy as np

from streamkit import (
    LUMA_CAPS,
    Caps,
    CapsEvent,
    Direction,
    EosEvent,
    Event,
    Flushing,
    FlushStart,
    FlushStop,
    Frame,
    FrameFlags,
    PadTemplate,
    Pose,
    Presence,
    Property,
    Registration,
    RegistrationStatus,
    ResourceError,
    Transform,
    luma,
)
from streamkit_kernels import COMPILING, telling
from streamkit_stitcher.flight_plan.plan import CameraView, FlightPlan, parse_strip, plan_strip
from streamkit_stitcher.live_mosaic import PREVIEW_CAPS, LiveMosaic, linked_pad
from streamkit_stitcher.mosaic.album import RecorderSettings
from streamkit_stitcher.mosaic.georeference import PositionFix
from streamkit_stitcher.mosaic.picture_file import check_location
from streamkit_stitcher.mosaic.seams import SeamKind
from streamkit_stitcher.mosaic.tiles import PictureArray
from streamkit_stitcher.mosaic_pad import MosaicPad
from streamkit_stitcher.plane.placement import Placement
from streamkit_stitcher.plane.settings import ModelChoice, PlaneSettings, ReferenceChoice
from streamkit_stitcher.plane.tracker import PlaneTracker
from streamkit_stitcher.registration.motion_models import FitLimits

_TO_BGR = {"I420": cv2.COLOR_YUV2BGR_I420, "NV12": cv2.COLOR_YUV2BGR_NV12}
# BGR for pictures of odd sizes, which have no halved colours.
_COLOUR_FIRST = Caps("video/x-raw, format={ I420, NV12, BGR, GRAY8 }")


class Stitch(Transform):
    """Attaches to each frame where it lies on the ground plane, and joins the frames to a mosaic.

    Pixels pass untouched. A frame that cannot be placed passes too, marked `lost`, with the camera's last
    motion carried on. After a cut, a new epoch or a new frame size the plane has another number and status
    `cut`. Where the plane moves - its reference changes, key frames were adjusted, the camera came back to
    ground it knows - the frame carries `reference_change`, so that whoever follows moves along.

    The mosaic is painted beside the stream, and written at EOS or when the pipeline stops before; a message
    `mosaic` tells its size. The pad `mosaic` shows it as it grows, from a thread of its own: whoever is slow
    there sees fewer states of it, and the last.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! fakesink
    """

    sink = src = LUMA_CAPS
    templates: ClassVar = (PadTemplate("mosaic", Direction.SRC, PREVIEW_CAPS, Presence.REQUEST),)

    location: str | None = Property(
        None, doc="Path of the mosaic, .png, .jpg or .tif; %d in it gives each plane a file."
    )
    reference: ReferenceChoice = Property(
        ReferenceChoice.AUTO,
        doc="Plane of the placements: the middle key frame's, which moves as the strip grows, or the first "
        "frame's; auto takes the middle where the strip's length is known.",
    )
    model: ModelChoice = Property(
        ModelChoice.AUTO, doc="What the motion may be; auto takes the simplest that explains the frames."
    )
    registration_width: int = Property(
        640, min=64, max=4096, unit="px", doc="Frames are halved to this width or less to follow the motion."
    )
    max_points: int = Property(
        220, min=20, max=2000, doc="Points compared in each frame; more is slower and steadier."
    )
    ransac_threshold: float = Property(
        1.0, min=0.1, max=20.0, unit="px at registration width", doc="Largest residual of an inlier."
    )
    min_inliers: int = Property(
        20, min=8, max=1000, doc="Fewest points that must agree on a homography; simpler motions need fewer."
    )
    min_inlier_ratio: float = Property(
        0.35, min=0.05, max=1.0, doc="Least share of the points in view that must agree on the motion."
    )
    keyframe_overlap: float = Property(
        0.65, min=0.3, max=0.95, doc="A frame that shares less than this with its key frame becomes one."
    )
    window: int = Property(
        12, min=0, max=60, doc="Newest key frames that are adjusted together at each new one; 0 for none."
    )
    ba_iterations: int = Property(8, min=1, max=100, doc="Most steps of such an adjustment.")
    huber: float = Property(1.5, min=0.1, unit="px", doc="Residual from which a tie point counts less.")
    strip_length: int = Property(
        0, min=0, max=100_000, doc="Key frames of the whole flight strip; 0 if nobody knows."
    )
    strip: str | None = Property(
        None, doc="Longitude and latitude of the strip's two ends, lon,lat,lon,lat; tells its length."
    )
    altitude: float = Property(0.0, min=0.0, unit="m", doc="Height above the ground, for `strip`.")
    field_of_view: float = Property(
        0.0, min=0.0, max=170.0, unit="deg", doc="Horizontal field of view of the camera, for `strip`."
    )
    speed: float = Property(0.0, min=0.0, unit="m/s", doc="Speed over the ground, for `strip`.")
    final: bool = Property(
        True, doc="At the end adjust all key frames together and blend them; else keep the mosaic as it grew."
    )
    seam: SeamKind = Property(
        SeamKind.GRAPHCUT,
        doc="How frames share the ground in the final mosaic: seams half-way, or moved round cars and trees.",
    )
    max_canvas_mpx: float = Property(
        64.0, min=1.0, max=1024.0, unit="Mpx", doc="Mosaic kept in memory; the rest goes to a temporary file."
    )
    preview_interval: float = Property(
        1.0, min=0.0, unit="s", doc="Least time between two frames of the pad `mosaic`."
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        super().__init__(name, **properties)
        self.prepare_run()

    def prepare_run(self) -> None:
        """Forgets what an earlier run left for the pad `mosaic`."""
        self._shown = MosaicPad(
            lambda: linked_pad(self), lambda: self.count_drop("mosaic: a newer picture came")
        )

    def start(self) -> None:
        """Begins without a plane; refuses a location or strip that could not be used at the end."""
        with telling(lambda: self.post_warning(COMPILING)):
            self._tracker = PlaneTracker(self._settings(0, 0))
        self._mosaic: LiveMosaic | None = None
        self._epoch: int | None = None
        try:
            if self.strip is not None:
                parse_strip(self.strip)
            if self.location is not None:
                check_location(self.location)
        except (OSError, ValueError) as error:
            raise ResourceError(f"{self.name}: {error}") from error
        if self.location is not None or "mosaic" in self.pads:
            settings = RecorderSettings(
                self.location, round(self.max_canvas_mpx * 1e6), self.final, self.seam
            )
            self._mosaic = LiveMosaic(self, settings, self.preview_interval, lambda: self._shown)

    def stream(self) -> None:
        """The body of the thread that serves the pad `mosaic`."""
        self._shown.serve(self.stopping)

    def interrupt(self) -> None:
        """Wakes that thread."""
        self._shown.wake()

    def query_caps(self, pad: Any) -> Caps:
        """What a pad can carry: the mosaic is made here, frames pass as they come."""
        if pad.name == "mosaic":
            return PREVIEW_CAPS
        return super().query_caps(pad)

    def property_changed(self, name: str) -> None:
        """A mosaic is better in colour, so colour is asked for first."""
        if name == "location" and self.location is not None:
            self._prefer_colour()

    def request_pad(self, template: PadTemplate, name: str = "") -> Any:
        """Makes the pad `mosaic`."""
        self._prefer_colour()
        return super().request_pad(template, name)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Reckons with the strip, now that the frames' size and rate are known."""
        if self.strip is None:
            return
        rate = sink_caps.get("framerate")
        shape = sink_caps.integer("height"), sink_caps.integer("width")
        plan = self._plan(self.strip, shape)
        frames = round(plan.interval_s * rate) if isinstance(rate, Fraction) and rate > 0 else 0
        self._tracker.close()
        self._tracker = PlaneTracker(self._settings(plan.images, max(1, frames)))
        self.post_message("flight-plan", **asdict(plan))

    def transform(self, frame: Frame) -> Frame:
        """Attaches Registration to the frame and lays it into the mosaic where it shows new ground."""
        if self._epoch is not None and frame.epoch != self._epoch:
            self._tracker.restart()
        self._epoch = frame.epoch
        if frame.flags & FrameFlags.CORRUPT:
            return frame.attach(registration(self._tracker.skip()))
        grey = brightness_of(frame)
        placement = self._tracker.place(grey)
        if self._mosaic is not None:
            if self._mosaic.is_other_plane(placement):
                self._mosaic.leave(self._tracker.take_plane())
            shape = int(grey.shape[0]), int(grey.shape[1])
            self._mosaic.record(frame, placement, shape, partial(picture_of, frame), position_of(frame))
        return frame.attach(registration(placement))

    def event(self, event: Event) -> None:
        """Events reach whoever watches the mosaic, too."""
        if isinstance(event, FlushStart | FlushStop):
            self._shown.flush(event)
        elif not isinstance(event, CapsEvent | EosEvent):
            self._shown.put_event(event)

    def drain(self) -> tuple[()]:
        """Shows the mosaic for the last time and writes it.

        Raises:
            ResourceError: it cannot be written.
        """
        plane = self._tracker.take_plane(current=True)
        try:
            if self._mosaic is not None:
                self._mosaic.show_last()
                if not self._mosaic.finish(plane, self.stopping):
                    raise Flushing(self.name)
            elif plane is not None:
                plane.close()
        except OSError as error:
            raise ResourceError(f"{self.name}: the mosaic is lost: {error}") from error
        finally:
            # Last: whoever watched to the end finds the file written.
            self._shown.put_event(EosEvent())
        return ()

    def stop(self) -> None:
        """Writes the mosaic if EOS did not come, and lets go of it."""
        mosaic, self._mosaic = self._mosaic, None
        if mosaic is not None:
            try:
                mosaic.finish(self._tracker.take_plane(current=True))
            except OSError as error:
                self.post_warning(f"the mosaic is lost: {error}")
            finally:
                mosaic.close()
        self._tracker.close()

    def _prefer_colour(self) -> None:
        for name in ("sink", "src"):
            pad = self.pads[name]
            pad.template = replace(pad.template, caps=_COLOUR_FIRST)

    def _settings(self, strip_length: int, interval: int) -> PlaneSettings:
        limits = FitLimits(
            threshold=self.ransac_threshold, min_inliers=self.min_inliers, min_ratio=self.min_inlier_ratio
        )
        reference, length = self.reference, strip_length or self.strip_length
        if reference is ReferenceChoice.AUTO:
            reference = ReferenceChoice.CENTER if length else ReferenceChoice.FIRST
        return PlaneSettings(
            working_width=self.registration_width,
            max_points=self.max_points,
            limits=limits,
            keyframe_overlap=self.keyframe_overlap,
            keyframe_interval=interval,
            model=self.model,
            reference=reference,
            strip_length=length,
            window=self.window,
            adjustment_iterations=self.ba_iterations,
            huber=self.huber,
        )

    def _plan(self, strip: str, shape: tuple[int, int]) -> FlightPlan:
        try:
            view = CameraView.of_width(math.radians(self.field_of_view), shape)
            return plan_strip(
                parse_strip(strip), self.altitude, view, self.keyframe_overlap, self.speed, shape[1]
            )
        except (ValueError, ZeroDivisionError) as error:
            raise ResourceError(
                f"{self.name}: strip needs altitude, field-of-view and speed above 0: {error}"
            ) from error
        except ImportError as error:
            raise ResourceError(
                f"{self.name}: strip needs pyproj; install streamkit with its extra: "
                "pip install 'streamkit[geo]'"
            ) from error


def registration(placement: Placement) -> Registration:
    """A placement as metadata."""
    return Registration(
        placement.to_previous,
        placement.to_reference,
        reference=placement.reference,
        reference_change=placement.change,
        status=RegistrationStatus(placement.status.value),
        keyframe=placement.keyframe,
        matches=placement.matches,
        inliers=placement.inliers,
        rmse=placement.rmse,
    )


def brightness_of(frame: Frame) -> PictureArray:
    """What a frame is placed by: its plane of brightness uint8[h, w], or one made of BGR."""
    if frame.caps["format"] == "BGR":
        return np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return luma(frame)


def picture_of(frame: Frame) -> PictureArray:
    """A frame for the mosaic: uint8[h, w, 3] BGR where it has colour, else its brightness uint8[h, w]."""
    pixel_format = str(frame.caps["format"])
    code = _TO_BGR.get(pixel_format)
    if code is None:
        return np.asarray(frame.data, dtype=np.uint8) if pixel_format == "BGR" else luma(frame)
    return np.asarray(cv2.cvtColor(frame.data, code), dtype=np.uint8)


def position_of(frame: Frame) -> PositionFix | None:
    """Where the camera was, if the frame tells and its telemetry is not too old."""
    pose = frame.get(Pose)
    return None if pose is None or pose.is_stale else PositionFix(pose.latitude, pose.longitude)
