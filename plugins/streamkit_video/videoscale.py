"""videoscale: raw video in another size."""

from __future__ import annotations

from streamkit import Caps, Frame, IntRange, NotNegotiated, Property, Transform
from streamkit_video.pixel_formats import FORMATS, PLANAR, odd_size, size_allows
from streamkit_video.scaled_metadata import scale_metadata
from streamkit_video.scaling import ScaleMethod, Size, scale_picture, scaling_homography

LARGEST_SIDE = 32767
"""OpenCV scales no larger pictures."""


class VideoScale(Transform):
    """Scales raw video to the size that the caps after it ask for.

    Where they ask for none, frames pass untouched. Where only the width or the height is asked for, the other
    follows in proportion. Registration, detections and tracks are carried over to the new pixels.

    Example:
        videotestsrc num-buffers=5 ! videoscale ! video/x-raw, width=160, height=120 ! fakesink
    """

    sink = src = (
        f"video/x-raw, format={{ {', '.join(FORMATS)} }}, "
        f"width=[ 1, {LARGEST_SIDE} ], height=[ 1, {LARGEST_SIDE} ]"
    )

    method: ScaleMethod = Property(
        ScaleMethod.LINEAR, live=True, doc="Interpolation; bilinear2 averages and is best for shrinking much."
    )

    def start(self) -> None:
        """Forgets an earlier run."""
        self._before: Size = (0, 0)
        self._after: Size = (0, 0)
        self._scaling = self._previous_scaling = scaling_homography((1, 1), (1, 1))

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """The same caps, and the same in every size."""
        if caps.is_any:
            return self.pads["sink"].template.caps
        side = IntRange(1, LARGEST_SIDE)
        return caps | caps.with_fields(width=side, height=side)

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        """The sink's own size if allowed, else the nearest, in proportion where only one side is given."""
        same = allowed & sink_caps
        if not same.is_empty:
            return same.fixate()
        width, height = sink_caps.integer("width"), sink_caps.integer("height")
        caps = allowed.fixate(near=sink_caps)
        free = {name: isinstance(allowed.get(name), IntRange) for name in ("width", "height")}
        if free["height"] and not free["width"]:
            side = self._in_proportion(height, caps.integer("width"), width, sink_caps)
            caps = allowed.fixate(near=sink_caps.with_fields(height=side))
        elif free["width"] and not free["height"]:
            side = self._in_proportion(width, caps.integer("height"), height, sink_caps)
            caps = allowed.fixate(near=sink_caps.with_fields(width=side))
        return caps

    def _in_proportion(self, side: int, other_after: int, other_before: int, sink_caps: Caps) -> int:
        step = 2 if sink_caps["format"] in PLANAR else 1
        return max(step, round(side * other_after / other_before / step) * step)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Remembers the sizes; refuses those that the format cannot have."""
        self._before = (sink_caps.integer("width"), sink_caps.integer("height"))
        self._after = (src_caps.integer("width"), src_caps.integer("height"))
        self._format = str(src_caps["format"])
        for size in (self._before, self._after):
            if self._before != self._after and not size_allows(self._format, *size):
                raise NotNegotiated(f"{self.name}: {odd_size(self._format, *size)}")
        self._scaling = scaling_homography(self._before, self._after)

    def transform(self, frame: Frame) -> Frame:
        """The frame in the size agreed."""
        previous, self._previous_scaling = self._previous_scaling, self._scaling
        if self._before == self._after:
            return frame
        data = scale_picture(frame.data, self._format, self._after, self.method)
        if frame.metadata:
            frame = scale_metadata(frame, self._scaling, previous)
        return frame.replace(data=data, caps=self.src_caps)
