"""stitch: registers each frame to the ground plane and builds a mosaic."""

from __future__ import annotations

import math
from dataclasses import asdict, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from streamkit import (
    LUMA_CAPS,
    Caps,
    CapsEvent,
    Direction,
    EosEvent,
    Event,
    FlushEvent,
    Flushing,
    Frame,
    FrameFlags,
    GroundReference,
    HiddenPixels,
    IfExists,
    Pad,
    PadTemplate,
    Pose,
    Presence,
    Property,
    PropertyError,
    Registration,
    ResourceError,
    SettingsOf,
    Transform,
    luma,
    needs_extra,
)
from streamkit.geometry.homography import centre, project
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.output.names import FileNames
from streamkit_kernels import start_kernels
from streamkit_kernels.hidden_pixels import without_hidden
from streamkit_stitcher.flight_plan.plan import FlightPlan, parse_strip, plan_strip
from streamkit_stitcher.ground_view import ground_view
from streamkit_stitcher.live_ground import LiveGround
from streamkit_stitcher.live_mosaic import PREVIEW_CAPS, LiveMosaic, linked_pad
from streamkit_stitcher.mosaic.georeference import Georeference
from streamkit_stitcher.mosaic.image_file import SUFFIXES, check_location
from streamkit_stitcher.mosaic.settings import RecorderSettings
from streamkit_stitcher.mosaic.tiles import ImageArray
from streamkit_stitcher.mosaic_pad import MosaicPad
from streamkit_stitcher.plane.frame_registration import FrameRegistration
from streamkit_stitcher.plane.registrar import FrameRegistrar
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.warm_up import warm_up
from streamkit_telemetry_formats.dji import camera_view

# BGR for frames of odd sizes, which have no subsampled colour planes.
_COLOUR_FIRST = Caps("video/x-raw, format={ I420, NV12, BGR, GRAY8 }")


_REGISTRATION_FIELDS = [field.name for field in fields(Registration)]


class Stitch(Transform):
    """Attaches to each frame its homography to the ground plane, and builds a mosaic.

    Pixels pass unchanged. A frame that cannot be registered passes with status `lost` and the predicted
    motion. A cut, a new epoch or a new frame size starts another plane, with status `cut`. When the plane
    moves (its reference changes, keyframes are adjusted, the camera revisits known ground) the frame carries
    `reference_change`, so that downstream elements can move their state along.

    The mosaic is painted in a background thread, and written at EOS or when the pipeline stops earlier; the
    message `mosaic` reports its size and position. If no frame could be registered there is no mosaic, and a
    warning says so. At the end the message `summary` counts the frames by status and the planes, and repeats
    what the largest mosaic is. The pad `mosaic` shows it while it grows, from a thread of its own: a slow
    consumer gets fewer updates, and always the last.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! fakesink
    """

    sink = src = LUMA_CAPS
    templates: ClassVar = (PadTemplate("mosaic", Direction.SRC, PREVIEW_CAPS, Presence.REQUEST),)

    settings = SettingsOf(PlaneSettings)
    recording = SettingsOf(RecorderSettings)
    strip: str | None = Property(
        None, doc="Longitude and latitude of the strip's two ends, lon,lat,lon,lat; sets its length."
    )
    altitude: float = Property(0.0, min=0.0, unit="m", doc="Height above the ground, for `strip`.")
    field_of_view: float = Property(
        0.0,
        min=0.0,
        max=170.0,
        unit="deg",
        doc="Horizontal field of view of the camera, for `strip`, and where telemetry has none.",
    )
    drone: str = Property(
        "",
        doc="DJI model, such as mini-2, for its field of view where telemetry has none.",
    )
    ground_altitude: float | None = Property(
        None, unit="m", doc="Altitude of the ground with the datum of the poses; by default as reported."
    )
    speed: float = Property(0.0, min=0.0, unit="m/s", doc="Speed over the ground, for `strip`.")
    if_exists: IfExists = Property(
        IfExists.REPLACE, doc="An older mosaic: refuse it, continue its numbers, or replace it when whole."
    )
    preview_interval: float = Property(
        1.0, min=0.0, unit="s", doc="Least time between two frames of the pad `mosaic`."
    )

    def begin_run(self) -> None:
        """Drops the state of the pad `mosaic` from an earlier run."""
        super().begin_run()
        self._mosaic_pad = MosaicPad(
            lambda: linked_pad(self), lambda: self.count_drop("mosaic: a newer frame came")
        )

    def start(self) -> None:
        """Starts without a plane.

        Raises:
            ResourceError: the location or the strip cannot be used.
        """
        start_kernels("streamkit_stitcher", warm_up, is_live=self.query_live(), report=self.post_warning)
        self._registrar = FrameRegistrar(self.settings)
        self._mosaic: LiveMosaic | None = None
        self._ground = LiveGround()
        self._epoch: int | None = None
        self._is_summarised = False
        recording = self.recording
        try:
            if self.strip is not None:
                parse_strip(self.strip)
            if recording.location is not None:
                check_location(recording.location)
                recording = self._protect_files(recording.location)
        except (OSError, ValueError) as error:
            raise ResourceError(f"{self.name}: {error}") from error
        if recording.location is not None or "mosaic" in self.pads:
            self._mosaic = LiveMosaic(self, recording, self.preview_interval, lambda: self._mosaic_pad)

    def stream(self) -> None:
        """The body of the thread of the pad `mosaic`."""
        self._mosaic_pad.serve(self.stopping)

    def interrupt(self) -> None:
        """Wakes that thread."""
        self._mosaic_pad.wake()

    def side_pads(self) -> list[Pad]:
        """None for the base to forward events to: `mosaic` gets them in order, from its own thread."""
        return []

    def property_changed(self, name: str) -> None:
        """Prefers colour formats when a mosaic is to be written."""
        if name == "location" and self.recording.location is not None:
            self._prefer_colour()

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes the pad `mosaic`."""
        self._prefer_colour()
        return super().request_pad(template, name)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Plans the strip, as the frames' size and rate are known now."""
        if self.strip is None:
            return
        rate = sink_caps.get("framerate")
        plan = self._plan(self.strip, (sink_caps.integer("height"), sink_caps.integer("width")))
        interval = round(plan.interval_s * rate) if isinstance(rate, Fraction) and rate > 0 else 0
        self._registrar.close()
        self._registrar = FrameRegistrar(
            replace(self.settings, strip_length=plan.images, keyframe_interval=max(1, interval))
        )
        self.post_message("flight-plan", **asdict(plan))

    def transform(self, frame: Frame) -> Frame:
        """Attaches `Registration`, and adds the frame to the mosaic where it shows new ground."""
        if self._epoch is not None and frame.epoch != self._epoch:
            self._registrar.restart()
        self._epoch = frame.epoch
        if frame.flags & FrameFlags.CORRUPT:
            self.outcomes[RegistrationStatus.LOST.value] += 1
            return frame.attach(registration(self._registrar.skip()))
        grey, hidden = grey_of(frame), frame.get(HiddenPixels)
        if hidden is not None:
            grey = without_hidden(grey, hidden.mask)
        registered = self._registrar.register(grey)
        self.outcomes[registered.status.value] += 1
        shape = int(grey.shape[0]), int(grey.shape[1])
        pose = frame.get(Pose)
        view_across = 0.0 if pose is None else self._view_across(shape)
        view = ground_view(pose, shape, self.ground_altitude, view_across, frame.pts)
        if self._mosaic is not None:
            if self._mosaic.recorder.is_new_plane(registered):
                self._mosaic.end_plane(self._registrar.take_plane())
                self._registrar.keep_planes(self._mosaic.recorder.has_room)
            self._mosaic.record(frame, registered, shape, view)
        frame = frame.attach(registration(registered))
        ground = self._ground.locate(registered, view)
        if ground is None:
            return frame
        reference = ground_reference(ground)
        error_m = reference.error_at(project(ground.to_local, centre(shape)[np.newaxis]))[0]
        return frame.attach(reference) if error_m <= self.recording.max_geo_error_m else frame

    def event(self, event: Event) -> None:
        """Passes events to the pad `mosaic`."""
        if isinstance(event, FlushEvent):
            self._mosaic_pad.flush(event)
        elif not isinstance(event, CapsEvent | EosEvent):
            self._mosaic_pad.put_event(event)

    def drain(self) -> tuple[()]:
        """Shows the mosaic for the last time and writes it.

        Raises:
            ResourceError: it cannot be written.
        """
        plane = self._registrar.take_plane(current=True)
        try:
            if self._mosaic is not None:
                self._mosaic.show_last()
                if not self._mosaic.finish(plane, self.stopping):
                    raise Flushing(self.name)
                self._count_files(self._mosaic)
            elif plane is not None:
                plane.close()
            self._summarise()
        except OSError as error:
            raise ResourceError(f"{self.name}: the mosaic is lost: {error}") from error
        finally:
            # Last: at EOS of the pad the file is complete.
            self._mosaic_pad.put_event(EosEvent())
        return ()

    def stop(self) -> None:
        """Writes the mosaic if EOS did not come, says what it is or that there is none, and releases it."""
        mosaic = self._mosaic
        try:
            if mosaic is not None:
                mosaic.finish(self._registrar.take_plane(current=True))
                self._count_files(mosaic)
            if self.outcomes and not self._is_summarised and self.pipeline_error() is None:
                self._summarise()
        except OSError as error:
            self.post_warning(f"the mosaic is lost: {error}")
        finally:
            if mosaic is not None:
                mosaic.close()
            self._mosaic = None
        self._registrar.close()

    def check_properties(self) -> None:
        """Checks the ending of the name, and the model.

        Raises:
            PropertyError: no mosaic can be written so, or the model is unknown.
        """
        if self.drone and camera_view(self.drone) is None:
            raise PropertyError(
                f"{self.name}: drone={self.drone}: its field of view is unknown; set field-of-view in degrees"
            )
        location = self.recording.location
        if location is not None and Path(location).suffix.lower() not in SUFFIXES:
            raise PropertyError(
                f"{self.name}: location={location}: the name must end in {', '.join(SUFFIXES)}, "
                f"it ends in {Path(location).suffix!r}; write for example location=mosaic.png"
            )

    def _view_across(self, shape: tuple[int, int]) -> float:
        """Horizontal field of view where telemetry has none, rad; 0 if unknown."""
        return math.radians(self.field_of_view) or camera_view(self.drone, shape[1] / shape[0]) or 0.0

    def _protect_files(self, location: str) -> RecorderSettings:
        """Checks `if-exists`; the settings with the number of the first file."""
        names = FileNames(location)
        there = list(names.existing())
        if not there or self.if_exists is IfExists.REPLACE:
            return self.recording
        if self.if_exists is IfExists.CONTINUE and names.has_number:
            return replace(self.recording, first_number=1 + max(number for _, number in there))
        raise FileExistsError(f"{location} exists already; name another file, or set if-exists=replace")

    def _count_files(self, mosaic: LiveMosaic) -> None:
        """Counts the mosaics written, also where the pipeline has failed."""
        if "file" in mosaic.summary:
            is_several = FileNames(str(self.recording.location)).is_several
            self.results["files"] = max(1, self._registrar.ended_planes) if is_several else 1

    def _summarise(self) -> None:
        """Posts the message `summary`, once the mosaics are written."""
        self._is_summarised = True
        states = {status.value: self.outcomes[status.value] for status in RegistrationStatus}
        frames = sum(states.values())
        if self.recording.location is not None and frames == states[RegistrationStatus.LOST]:
            reason = f"none of {frames} frames could be registered" if frames else "no frame came"
            self.post_warning(f"{self.recording.location}: no mosaic: {reason}", "shortfall")
        if frames:
            mosaic = {} if self._mosaic is None else self._mosaic.summary
            planes = max(1, self._registrar.ended_planes)
            self.post_message("summary", frames=frames, **states, planes=planes, **mosaic)

    def _prefer_colour(self) -> None:
        for name in ("sink", "src"):
            pad = self.pads[name]
            pad.template = replace(pad.template, caps=_COLOUR_FIRST)

    def _plan(self, strip: str, shape: tuple[int, int]) -> FlightPlan:
        try:
            ends, view, overlap = parse_strip(strip), self._view_across(shape), self.settings.keyframe_overlap
            with needs_extra(f"{self.name}: strip", "geo"):
                return plan_strip(ends, self.altitude, view, overlap, self.speed, shape)
        except (ValueError, ZeroDivisionError) as error:
            raise ResourceError(
                f"{self.name}: strip needs altitude, field-of-view and speed above 0: {error}"
            ) from error


def registration(registered: FrameRegistration) -> Registration:
    """The tracker's result as frame metadata."""
    return Registration(**{name: getattr(registered, name) for name in _REGISTRATION_FIELDS})


def ground_reference(ground: Georeference) -> GroundReference:
    """A frame's position on the earth as metadata."""
    latitude, longitude = ground.origin.latitude, ground.origin.longitude
    return GroundReference(ground.to_local, latitude, longitude, ground.error_m, ground.spread_m)


def grey_of(frame: Frame) -> ImageArray:
    """The frame's luma plane, or the grey values of BGR, uint8[h, w]."""
    if frame.caps["format"] == "BGR":
        return np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return luma(frame)
