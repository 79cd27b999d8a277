"""framediff: finds what moves in each frame, on the ground plane that the registration gives."""

from __future__ import annotations

import enum
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ClassVar

from streamkit import (
    LUMA_CAPS,
    Caps,
    CapsEvent,
    Detections,
    Direction,
    EndOfStream,
    EosEvent,
    Frame,
    FrameFlags,
    PadTemplate,
    Presence,
    Property,
    PropertyError,
    Registration,
    RegistrationStatus,
    ResourceError,
    Transform,
    luma,
    raw_video_caps,
)
from streamkit_differencer.anchor import Change, Motion
from streamkit_differencer.clusters import Criterion
from streamkit_differencer.differencer import Differencer, Result
from streamkit_differencer.model_settings import Event, ModelSettings
from streamkit_differencer.objects import NOTHING, Objects, ObjectSettings
from streamkit_differencer.pictures import full_size
from streamkit_differencer.region import RegionOfInterest
from streamkit_differencer.warm_up import warm_up
from streamkit_kernels import COMPILING, telling

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from streamkit import Event as StreamEvent

WORKING_SCALES = (0, 1, 2, 4)
MASK_CAPS = Caps("video/x-raw, format=GRAY8")
WEAK_REGISTRATION = 0.5
# A registration that fits no better than this is worth half, px.
POOR_RMSE_PX = 4.0


class MotionSource(enum.StrEnum):
    """Where the camera's motion is taken from."""

    AUTO = "auto"
    METADATA = "metadata"
    OWN = "own"
    NONE = "none"


class FrameDiff(Transform):
    """Attaches a detection for everything that moves: the difference from a background that it learns.

    A camera that flies needs `stitch` before this element; one that stands, shakes or turns slowly does not:
    its motion is measured here. The background is known half a second after a piece of ground came into view,
    and nothing is detected there before. The score of a detection is made of its contrast, how long it has
    been there and how well the frame was placed. A frame whose registration is lost, or that is corrupt, gets
    no detections and teaches nothing.

    The pad `mask` gives the foreground as pictures: 255 moves, 128 has stopped, 50 is shadow, 0 is ground.
    Messages `model` tell when the background is begun anew (`new`, `reset`), moved to another canvas
    (`reanchor`), made brighter or darker (`gain`), held because frames cannot be placed (`held`) and goes on
    (`resumed`); messages `crowded` tell of frames with more than `max-objects`.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! fakesink
    """

    sink = src = LUMA_CAPS
    templates: ClassVar = (PadTemplate("mask", Direction.SRC, MASK_CAPS, Presence.REQUEST),)
    motion: MotionSource = Property(
        MotionSource.AUTO,
        doc="The camera's: metadata is that of stitch, own is measured here, none is a fixed camera; "
        "auto takes metadata where frames have it, else own.",
    )
    working_scale: int = Property(
        0,
        min=0,
        max=4,
        unit="px",
        doc="Frame pixels per pixel of the model, along each axis: 1, 2 or 4; 0 goes by the frame's width.",
    )
    tau: int = Property(3, min=1, max=30, unit="frames", doc="Interval of the frame difference.")
    quiet_frames: int = Property(
        12, min=1, max=255, unit="frames", doc="Lambda: frames without change until a pixel is background."
    )
    ts: float = Property(
        18.0, min=0.0, max=255.0, live=True, unit="grey levels", doc="Change over tau frames that counts."
    )
    tf: float = Property(
        7.0, min=0.0, max=255.0, live=True, unit="grey levels", doc="Least difference that is foreground."
    )
    noise_gain: float = Property(
        4.0,
        min=0.0,
        max=20.0,
        live=True,
        doc="Deviations of a pixel's own noise that raise its tf; 0 for none.",
    )
    alpha: float = Property(
        0.08, min=0.0, max=1.0, live=True, unit="per frame", doc="Weight of a frame in the background."
    )
    tolerance: int = Property(
        -1,
        min=-1,
        max=8,
        live=True,
        unit="px",
        doc="Error of registration to bear, at the working scale; -1 is 0 at full resolution, else 1.",
    )
    weak: float = Property(
        0.5,
        min=0.0,
        max=1.0,
        live=True,
        doc="Share of its threshold from which a pixel beside foreground is foreground, too, where tolerance "
        "is not 0; 1 is off.",
    )
    gradient_gain: float = Property(
        0.3, min=0.0, max=4.0, live=True, doc="Raises both thresholds by this share of the local range."
    )
    frame_threshold: float = Property(
        0.6, min=0.05, max=1.0, live=True, doc="Share of changed pixels from which the model starts anew."
    )
    absorb: int = Property(
        60, min=0, max=255, live=True, unit="frames", doc="A thing that stands this long becomes background."
    )
    three_frame: bool = Property(
        False, doc="Uses the difference of three frames where there is no background; large things break up."
    )
    shadow: bool = Property(
        False,
        live=True,
        doc="Tells shadows from things, at a quarter more time; things as grey as a shadow suffer.",
    )
    ghost: bool = Property(
        True, live=True, doc="Notices things that were learnt as ground and have left, by their outlines."
    )
    flicker: bool = Property(
        False,
        live=True,
        doc="Leaves out what flickers, such as leaves, at a twentieth more time; dense traffic suffers.",
    )
    parallax: float = Property(
        0.2,
        min=0.0,
        max=1.0,
        live=True,
        doc="Under a moving camera leaves out what slides as things do whose height is up to this share of "
        "the camera's height above them; what drives towards the camera as slowly may be lost, too. "
        "0 is off.",
    )
    median: int = Property(
        5,
        min=0,
        max=13,
        live=True,
        unit="px",
        doc="Width of the median that cleans the foreground; 0 is off.",
    )
    fill_holes: bool = Property(False, live=True, doc="Makes foreground of what foreground encloses.")
    roi: str = Property(
        "",
        doc="Where to look: polygons '0,0 640,0 640,200; ...' in px or shares of the frame, or a picture "
        "that is white inside; everywhere if empty.",
    )
    min_area: int = Property(
        3, min=1, max=100000, live=True, unit="cells", doc="Smallest object; a cell is 4 by 4 px."
    )
    merge_gap: int = Property(
        -1,
        min=-1,
        max=100,
        live=True,
        unit="cells",
        doc="Fragments nearer than this are one object; -1 is 3 at full resolution, else 1.",
    )
    merge_criterion: Criterion = Property(
        Criterion.GAP, live=True, doc="gap: between fragments; scatter: of the cells in a cluster."
    )
    min_change: float = Property(
        0.25,
        min=0.0,
        max=1.0,
        live=True,
        doc="Share of an object that must have changed within quiet-frames; 0 also reports what has stopped.",
    )
    min_score: float = Property(0.0, min=0.0, max=1.0, live=True, doc="Smallest score reported.")
    max_objects: int = Property(
        50, min=1, max=10000, live=True, doc="Most detections in a frame; of more the surest are kept."
    )

    def start(self) -> None:
        """Begins without a model, with all loops over pixels compiled.

        Raises:
            PropertyError: working-scale is none of 0, 1, 2 and 4.
            ResourceError: roi cannot be read.
        """
        if self.working_scale not in WORKING_SCALES:
            raise PropertyError(
                f"{self.name}: property working-scale must be 0, 1, 2 or 4, got {self.working_scale}; "
                "use 0 to go by the frame's width"
            )
        try:
            self._region = RegionOfInterest(self.roi) if self.roi else None
        except ValueError as error:
            raise ResourceError(f"{self.name}: roi: {error}") from error
        with telling(lambda: self.post_warning(COMPILING)):
            warm_up()
        own = self.motion in (MotionSource.AUTO, MotionSource.OWN)
        self._differencer = Differencer(self.working_scale, own_motion=own)
        self._is_tuned = False
        self._last_seq: int | None = None
        self._crowded = self._has_warned = self._is_held = False
        self._last_event = Event.NONE
        self._mask_caps: Caps | None = None

    def property_changed(self, name: str) -> None:
        """The next frame is judged by it."""
        self._is_tuned = False

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """The region is drawn for the frames' size."""
        self._differencer.region = None
        if self._region is not None:
            size = sink_caps.integer("width"), sink_caps.integer("height")
            self._differencer.region = self._region.mask(*size)

    def query_caps(self, pad: Any) -> Caps:
        """What a pad can carry: masks are made here, frames pass as they come."""
        return MASK_CAPS if pad.name == "mask" else super().query_caps(pad)

    def transform(self, frame: Frame) -> Frame:
        """Attaches Detections; a frame that cannot be used gets none."""
        uses_metadata = self.motion in (MotionSource.AUTO, MotionSource.METADATA)
        registration = frame.get(Registration) if uses_metadata else None
        is_lost = registration is not None and registration.status == RegistrationStatus.LOST
        if is_lost or frame.flags & FrameFlags.CORRUPT:
            self._differencer.miss()
            result = None
        else:
            result = self._update(frame, registration)
        self._last_seq = frame.seq
        self._report(result)
        passed = frame.attach(detections(result.objects if result else NOTHING, self.min_score))
        if "mask" in self.pads:
            self._show(passed, result.foreground if result else None)
        return passed

    def event(self, event: StreamEvent) -> None:
        """Events reach whoever watches the mask, too."""
        pad = self._mask_pad
        if pad is not None and not isinstance(event, CapsEvent | EosEvent):
            pad.send_event(event)

    def drain(self) -> tuple[()]:
        """The masks end with the frames."""
        pad = self._mask_pad
        if pad is not None:
            pad.send_event(EosEvent())
        return ()

    @property
    def _mask_pad(self) -> Any:
        pad = self.pads.get("mask")
        return pad if pad is not None and pad.peer is not None else None

    def _show(self, frame: Frame, foreground: NDArray[np.uint8] | None) -> None:
        """Sends the foreground of a frame through the pad `mask`, with the frame's times and metadata."""
        pad = self._mask_pad
        if pad is None:
            return
        height, width = luma(frame).shape
        rate = frame.caps.get("framerate", None)
        caps = raw_video_caps("GRAY8", width, height, rate if isinstance(rate, Fraction) else None)
        if caps != self._mask_caps:
            self._mask_caps = caps
            pad.send_event(CapsEvent(caps))
        picture = full_size(foreground, width, height)
        try:
            pad.push(frame.replace(data=picture, caps=self._mask_caps))
        except EndOfStream:
            pad.unlink()

    def _update(self, frame: Frame, registration: Registration | None) -> Result | None:
        if not self._is_tuned:
            # First, so that what is set meanwhile is taken over with the next frame.
            self._is_tuned = True
            self._tune()
        if registration is not None and registration.status == RegistrationStatus.CUT:
            self._differencer.reset()
        # A frame dropped in between makes `to_previous` lead to a frame that was never seen here.
        is_next = self._last_seq is not None and frame.seq == self._last_seq + 1
        return self._differencer.update(luma(frame), motion(registration, is_next), quality(registration))

    def _tune(self) -> None:
        """Takes over the properties; building settings for each frame anew would cost more than it looks."""
        self._differencer.model_settings = ModelSettings(
            interval=self.tau,
            quiet_frames=self.quiet_frames,
            change_threshold=self.ts,
            foreground_threshold=self.tf,
            noise_gain=self.noise_gain,
            coefficient=self.alpha,
            tolerance=self.tolerance,
            weak=self.weak,
            gradient_gain=self.gradient_gain,
            frame_threshold=self.frame_threshold,
            absorb_frames=self.absorb,
            three_frame=self.three_frame,
            shadow=self.shadow,
            flicker=self.flicker,
            ghost=self.ghost,
        )
        self._differencer.object_settings = ObjectSettings(
            min_area=self.min_area,
            merge_gap=self.merge_gap,
            criterion=self.merge_criterion,
            min_score=self.min_change,
            max_objects=self.max_objects,
            median_px=self.median,
            fill_holes=self.fill_holes,
            parallax=self.parallax,
        )

    def _report(self, result: Result | None) -> None:
        """Tells on the bus what changed with this frame."""
        if (result is None) != self._is_held:
            self._is_held = result is None
            self.post_message("model", event="held" if self._is_held else "resumed")
        if result is None:
            return
        if result.event is Event.RESET or (result.event is Event.GAIN and self._last_event is Event.NONE):
            self.post_message("model", event=str(result.event))
        elif result.change in (Change.NEW, Change.REANCHOR):
            self.post_message("model", event=str(result.change))
        self._last_event = result.event
        dropped = result.objects.dropped
        if dropped and not self._crowded:
            self.post_message("crowded", found=len(result.objects) + dropped, kept=len(result.objects))
        if dropped and not self._has_warned:
            self._has_warned = True
            self.post_warning(
                f"more than max-objects={self.max_objects} detections in a frame, the least sure are left "
                "out: raise tf or min-area, or see whether the registration holds"
            )
        self._crowded = bool(dropped)


def motion(registration: Registration | None, is_next: bool) -> Motion | None:
    """A frame's registration as the differencer takes it; None where the frame has none.

    Args:
        registration: what the frame carries.
        is_next: whether the frame before it was seen here too.
    """
    if registration is None:
        return None
    return Motion(
        registration.to_reference,
        registration.to_previous if is_next else None,
        registration.reference,
        registration.reference_change,
    )


def quality(registration: Registration | None) -> float:
    """How well a frame was placed, 0 to 1; 1 for a camera without registration."""
    if registration is None:
        return 1.0
    if registration.status == RegistrationStatus.WEAK:
        return WEAK_REGISTRATION
    return 1.0 / (1.0 + registration.rmse / POOR_RMSE_PX)


def detections(objects: Objects, min_score: float) -> Detections:
    """Objects as metadata, those with a smaller score left out."""
    kept = objects.confidences >= min_score
    return Detections(
        objects.centroids[kept], objects.boxes[kept], objects.areas[kept], objects.confidences[kept]
    )
