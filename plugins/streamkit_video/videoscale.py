"""videoscale: scales raw video, and its metadata with it."""

from __future__ import annotations

import cv2
import numpy as np
from typing_extensions import override

from streamkit import Caps, Choice, IntRange, Property
from streamkit.geometry.scaling import scaling_homography
from streamkit_video.pixel_formats import FORMATS, PLANAR, ByteArray, map_planes
from streamkit_video.reframing import FloatArray, ReframingTransform, Size

SIDES = ("width", "height")
FOR_ANY_SIZE = Caps(f"video/x-raw, format={{ {', '.join(name for name in FORMATS if name not in PLANAR)} }}")
MAX_SIDE = 32767  # limit of OpenCV's resize, px


class ScaleMethod(Choice):
    """Interpolation: GStreamer's words and numbers, where OpenCV has the filter."""

    NEAREST = "nearest-neighbour", 0, "Nearest Neighbour"
    LINEAR = "bilinear", 1, "Bilinear (2-tap)"
    CUBIC = "4-tap", 2, "4-tap Sinc"
    LANCZOS = "lanczos", 3, "Lanczos"
    AREA = "bilinear2", 4, "Bilinear (multi-tap)"


INTERPOLATIONS = {
    # Plain INTER_NEAREST is half a pixel off when shrinking; the exact one agrees with the others.
    ScaleMethod.NEAREST: cv2.INTER_NEAREST_EXACT,
    ScaleMethod.LINEAR: cv2.INTER_LINEAR,
    ScaleMethod.CUBIC: cv2.INTER_CUBIC,
    ScaleMethod.LANCZOS: cv2.INTER_LANCZOS4,
    # Averages all pixels that fall into the new one, as GStreamer's multi-tap filter does.
    ScaleMethod.AREA: cv2.INTER_AREA,
}


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
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any:
            return self.pads["sink"].template.caps
        if direction == "src":
            caps = possible_formats(caps)
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
    def mapping(self, before: Size, after: Size) -> FloatArray:
        return scaling_homography(before, after)

    @override
    def reframed(self, data: ByteArray, pixel_format: str, after: Size) -> ByteArray:
        return scale_image(data, pixel_format, after, self.method)


def possible_formats(caps: Caps) -> Caps:
    """Caps without I420 and NV12 where the size is odd, if any other format is left."""
    odd = tuple(
        structure
        for structure in caps.structures
        if any(isinstance(side := structure.fields.get(name), int) and side % 2 for name in SIDES)
    )
    left = Caps(tuple(one for one in caps.structures if one not in odd)) | (Caps(odd) & FOR_ANY_SIZE)
    return left if odd and not left.is_empty else caps


def scale_image(data: ByteArray, pixel_format: str, size: Size, method: ScaleMethod) -> ByteArray:
    """A frame, uint8 laid out as `pixel_format`, in another size, width and height px; a new array."""

    def scale(plane: ByteArray, step: int) -> ByteArray:
        part = size[0] // step, size[1] // step
        return np.asarray(cv2.resize(plane, part, interpolation=INTERPOLATIONS[method]), np.uint8)

    return map_planes(data, pixel_format, scale)
