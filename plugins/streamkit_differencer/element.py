"""framediff: finds what moves in each frame, on the ground plane that the registration gives."""

from __future__ import annotations

from streamkit import (
    LUMA_CAPS,
    Detections,
    Frame,
    FrameFlags,
    Property,
    PropertyError,
    Registration,
    RegistrationStatus,
    Transform,
    luma,
)
from streamkit_differencer.anchor import Change, Motion
from streamkit_differencer.clusters import Criterion
from streamkit_differencer.differencer import Differencer, Result
from streamkit_differencer.model import Event, ModelSettings
from streamkit_differencer.objects import NOTHING, Objects, ObjectSettings

WORKING_SCALES = (1, 2, 4)


class FrameDiff(Transform):
    """Attaches a detection for everything that moves: the difference from a background that it learns.

    A camera that moves needs `stitch` before this element; frames without registration are taken for those of
    a fixed camera. The background is known half a second after a piece of ground came into view, and nothing
    is detected there before. The score of a detection is the share of it that changed within `quiet-frames`.
    A frame whose registration is lost, or that is corrupt, gets no detections and teaches nothing.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! fakesink
    """

    sink = src = LUMA_CAPS
    working_scale: int = Property(
        2, min=1, max=4, unit="px", doc="Frame pixels per pixel of the model, along each axis: 1, 2 or 4."
    )
    tau: int = Property(3, min=1, max=30, unit="frames", doc="Interval of the frame difference.")
    quiet_frames: int = Property(
        12, min=1, max=255, unit="frames", doc="Lambda: frames without change until a pixel is background."
    )
    ts: float = Property(
        18.0, min=0.0, max=255.0, live=True, unit="grey levels", doc="Change over tau frames that counts."
    )
    tf: float = Property(
        22.0, min=0.0, max=255.0, live=True, unit="grey levels", doc="Difference that is foreground."
    )
    alpha: float = Property(
        0.08, min=0.0, max=1.0, live=True, unit="per frame", doc="Weight of a frame in the background."
    )
    tolerance: int = Property(
        1, min=0, max=8, live=True, unit="px", doc="Error of registration to bear, at the working scale."
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
    min_area: int = Property(
        3, min=1, max=100000, live=True, unit="cells", doc="Smallest object; a cell is 4 by 4 px."
    )
    merge_gap: int = Property(
        2, min=0, max=100, live=True, unit="cells", doc="Fragments nearer than this are one object."
    )
    merge_criterion: Criterion = Property(
        Criterion.GAP, live=True, doc="gap: between fragments' boxes; scatter: of the cells in a cluster."
    )
    min_score: float = Property(
        0.25, min=0.0, max=1.0, live=True, doc="Smallest score reported; 0 also reports what has stopped."
    )
    max_objects: int = Property(400, min=1, max=10000, live=True, doc="Most detections in a frame.")

    def start(self) -> None:
        """Begins without a model."""
        if self.working_scale not in WORKING_SCALES:
            raise PropertyError(
                f"{self.name}: property working-scale must be 1, 2 or 4, got {self.working_scale}; "
                "use 2 for full HD and below, 4 above"
            )
        self._differencer = Differencer(self.working_scale)
        self._last_seq: int | None = None
        self._crowded = False

    def transform(self, frame: Frame) -> Frame:
        """Attaches Detections; a frame that cannot be used gets none."""
        registration = frame.get(Registration)
        is_lost = registration is not None and registration.status == RegistrationStatus.LOST
        if is_lost or frame.flags & FrameFlags.CORRUPT:
            self._differencer.miss()
            result = None
        else:
            result = self._update(frame, registration)
        self._last_seq = frame.seq
        return frame.attach(detections(result.objects if result else NOTHING))

    def _update(self, frame: Frame, registration: Registration | None) -> Result | None:
        self._tune()
        if registration is not None and registration.status == RegistrationStatus.CUT:
            self._differencer.reset()
        # A frame dropped in between makes `to_previous` lead to a frame that was never seen here.
        is_next = self._last_seq is not None and frame.seq == self._last_seq + 1
        result = self._differencer.update(luma(frame), motion(registration, is_next))
        if result is not None:
            self._report(result)
        return result

    def _tune(self) -> None:
        """Takes over the properties, which may change while playing."""
        self._differencer.model_settings = ModelSettings(
            interval=self.tau,
            quiet_frames=self.quiet_frames,
            change_threshold=self.ts,
            foreground_threshold=self.tf,
            coefficient=self.alpha,
            tolerance=self.tolerance,
            gradient_gain=self.gradient_gain,
            frame_threshold=self.frame_threshold,
            absorb_frames=self.absorb,
            three_frame=self.three_frame,
        )
        self._differencer.object_settings = ObjectSettings(
            min_area=self.min_area,
            merge_gap=self.merge_gap,
            criterion=self.merge_criterion,
            min_score=self.min_score,
            max_objects=self.max_objects,
        )

    def _report(self, result: Result) -> None:
        if result.event is Event.RESET:
            self.post_message("model", event=str(Event.RESET))
        elif result.change in (Change.NEW, Change.REANCHOR):
            self.post_message("model", event=str(result.change))
        if result.objects.dropped and not self._crowded:
            self._crowded = True
            self.post_warning(
                f"more than max-objects={self.max_objects} detections in a frame, the smallest are left out: "
                "raise tf or min-area, or see whether the registration holds"
            )


def motion(registration: Registration | None, is_next: bool) -> Motion | None:
    """A frame's registration as the differencer takes it; None for a fixed camera.

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


def detections(objects: Objects) -> Detections:
    """Objects as metadata."""
    return Detections(objects.centroids, objects.boxes, objects.areas, objects.scores)
