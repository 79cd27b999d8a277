"""rectify: undistorts, levels and crops frames."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from streamkit import Caps, Frame, IntRange, NotNegotiated, Pose, Property, ResourceError, Transform
from streamkit_stitcher.flight_plan.rectification import (
    STRAIGHT_DOWN,
    CameraIntrinsics,
    Rectifier,
    camera_tilt,
    halved_maps,
    resampled,
)

_SIDE = IntRange(2, 32766, 2)


class Rectify(Transform):
    """Undistorts frames, levels them by their `Pose`, and crops them to one size without empty corners.

    Put it before `stitch`. A frame without a pose, or with a stale one, is undistorted only. A frame
    tilted by more than `max-tilt` is levelled by `max-tilt` only.

    Example:
        videotestsrc num-buffers=5 ! rectify field-of-view=70 distortion=-0.1,0.02,0,0 ! fakesink
    """

    sink = "video/x-raw, format={ GRAY8, I420, BGR, RGB }, width=[ 16, 32766 ], height=[ 16, 32766 ]"
    src = "video/x-raw, format={ GRAY8, I420, BGR, RGB }, width=[ 2, 32766, 2 ], height=[ 2, 32766, 2 ]"

    focal_px: float = Property(0.0, min=0.0, unit="px", doc="Focal length of the camera.")
    field_of_view: float = Property(
        0.0, min=0.0, max=170.0, unit="deg", doc="Horizontal field of view, where focal-px is not known."
    )
    principal: str | None = Property(None, doc="Principal point, x,y in px; else the middle of the frame.")
    distortion: str | None = Property(None, doc="Brown's k1,k2,p1,p2 or k1,k2,p1,p2,k3; OpenCV's order.")
    level: bool = Property(True, doc="Remove the tilt that the pose reports.")
    max_tilt: float = Property(
        5.0,
        min=0.0,
        max=30.0,
        unit="deg",
        doc="Largest tilt that leaves no empty corners; a larger value crops more.",
    )
    aspect: Fraction = Property(
        Fraction(4, 3), min=Fraction(1, 4), max=Fraction(4), doc="Width over height of the crop."
    )

    def start(self) -> None:
        """Checks the camera.

        Raises:
            ResourceError: neither focal length nor field of view is set, or a text is not numbers.
        """
        if not (self.focal_px > 0 or self.field_of_view > 0):
            raise ResourceError(
                f"{self.name}: the camera must be known, focal-px and field-of-view are both 0; "
                "set one of them, for instance field-of-view=70"
            )
        self._camera((16, 16))

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """The same format at the rectified size."""
        if caps.is_any:
            return self.pads["sink" if direction == "src" else "src"].template.caps
        if direction == "sink" and caps.is_fixed:
            width, height = self._rectifier_of(caps).size
            return caps.with_fields(width=width, height=height)
        side = _SIDE if direction == "sink" else IntRange(16, 32766)
        return caps.with_fields(width=side, height=side)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Computes the crop for the frames' size."""
        self._rectifier = self._rectifier_of(sink_caps)
        self._is_planar = sink_caps["format"] == "I420"

    def transform(self, frame: Frame) -> Frame:
        """Rectifies a frame."""
        maps = self._rectifier.maps(*self._tilt(frame))
        if not self._is_planar:
            return frame.replace(data=resampled(frame.data, maps), caps=self.src_caps)
        height, width = frame.data.shape[0] * 2 // 3, frame.data.shape[1]
        small = halved_maps(maps)
        chroma = frame.data[height:].reshape(2, height // 2, width // 2)
        planes = [resampled(frame.data[:height], maps), *(resampled(plane, small) for plane in chroma)]
        whole: npt.NDArray[np.uint8] = np.concatenate([plane.ravel() for plane in planes])
        return frame.replace(data=whole.reshape(-1, self._rectifier.size[0]), caps=self.src_caps)

    def _tilt(self, frame: Frame) -> tuple[float, float]:
        """Roll and pitch to remove; missing or excessive tilt is reported once."""
        if not self.level:
            return 0.0, 0.0
        pose = frame.get(Pose)
        if pose is None or pose.is_stale or (pose.sensor_angles is None and pose.pitch is None):
            self.warn_once("a frame has no pose with its tilt and is not levelled; others may follow")
            return 0.0, 0.0
        tilt = camera_tilt(pose.pitch or 0.0, pose.roll or 0.0, pose.sensor_angles or STRAIGHT_DOWN)
        if not self._rectifier.can_level(*tilt):
            degrees = math.degrees(math.hypot(*tilt))
            self.warn_once(
                f"a frame is tilted by {degrees:.1f} degrees and levelled up to max-tilt only; "
                "others may follow",
                code="max-tilt",
            )
        return tilt

    def _rectifier_of(self, caps: Caps) -> Rectifier:
        shape = caps.integer("height"), caps.integer("width")
        max_tilt = math.radians(self.max_tilt) if self.level else 0.0
        try:
            return Rectifier(self._camera(shape), shape, float(self.aspect), max_tilt)
        except ValueError as error:
            raise NotNegotiated(f"{self.name}: {error}") from error

    def _camera(self, shape: tuple[int, int]) -> CameraIntrinsics:
        focal = self.focal_px or shape[1] / (2 * math.tan(math.radians(self.field_of_view) / 2))
        principal = self._numbers("principal", self.principal, (2,))
        distortion = self._numbers("distortion", self.distortion, (4, 5))
        return CameraIntrinsics(
            focal, (principal[0], principal[1]) if principal else None, distortion or (0.0,) * 5
        )

    def _numbers(self, name: str, text: str | None, counts: tuple[int, ...]) -> tuple[float, ...]:
        if text is None:
            return ()
        try:
            numbers = tuple(float(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in counts or not all(math.isfinite(number) for number in numbers):
            wanted = " or ".join(str(count) for count in counts)
            raise ResourceError(f"{self.name}: {name} must be {wanted} numbers with commas, got {text!r}")
        return numbers
