"""videoscale: scales raw video, and its metadata with it."""

from __future__ import annotations

from typing_extensions import override

from streamkit import Caps, Frame, IntRange, NotNegotiated, Property
from streamkit.geometry.scaling import scaling_homography
from streamkit_video.pixel_formats import FORMATS, PLANAR, odd_size_error, supports_size
from streamkit_video.reframing import ReframingTransform
from streamkit_video.scaling import ScaleMethod, Size, scale_image

MAX_SIDE = 32767
"""Limit of OpenCV's resize, px."""


class VideoScale(ReframingTransform):
    """Scales raw video to the size that the caps after it ask for.

    Frames pass unchanged where no size is asked for. Where only the width or the height is given, the other
    follows in proportion. Registration, detections and tracks are scaled with the frame.

    Example:
        videotestsrc num-buffers=5 ! videoscale ! video/x-raw, width=160, height=120 ! fakesink
    """

    sink = src = (
        f"video/x-raw, format={{ {', '.join(FORMATS)} }}, width=[ 1, {MAX_SIDE} ], height=[ 1, {MAX_SIDE} ]"
    )

    method: ScaleMethod = Property(
        ScaleMethod.LINEAR,
        live=True,
        doc="Interpolation; bilinear2 averages and is best for strong shrinking.",
    )

    @override
    def start(self) -> None:
        super().start()
        self._before: Size = (0, 0)
        self._after: Size = (0, 0)

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any:
            return self.pads["sink"].template.caps
        side = IntRange(1, MAX_SIDE)
        return caps | caps.with_fields(width=side, height=side)

    @override
    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        """The sink's size if allowed, else the nearest, in proportion where only one side is given."""
        same = allowed & sink_caps
        if not same.is_empty:
            return same.fixate()
        caps = allowed.fixate(near=sink_caps)
        step = 2 if sink_caps["format"] in PLANAR else 1
        for free, given in (("width", "height"), ("height", "width")):
            if isinstance(allowed.get(free), IntRange) and not isinstance(allowed.get(given), IntRange):
                side = sink_caps.integer(free) * caps.integer(given) / sink_caps.integer(given)
                side = max(step, round(side / step) * step)
                caps = allowed.fixate(near=sink_caps.with_fields(**{free: side}))
        return caps

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._before = (sink_caps.integer("width"), sink_caps.integer("height"))
        self._after = (src_caps.integer("width"), src_caps.integer("height"))
        self._format = str(src_caps["format"])
        for size in (self._before, self._after):
            if self._before != self._after and not supports_size(self._format, *size):
                raise NotNegotiated(f"{self.name}: {odd_size_error(self._format, *size)}")
        self.mapping = scaling_homography(self._before, self._after)

    @override
    def transform(self, frame: Frame) -> Frame:
        if self._before == self._after:
            return self.reframed(frame, None)
        return self.reframed(frame, scale_image(frame.data, self._format, self._after, self.method))
