"""videoflip: turns and mirrors raw video."""

from __future__ import annotations

from typing_extensions import override

from streamkit import Caps, Frame, Property, Structure
from streamkit_video.arrangement import VideoDirection, flip_homography, flip_image, swaps_sides
from streamkit_video.pixel_formats import FORMATS
from streamkit_video.reframing import ReframingTransform


class VideoFlip(ReframingTransform):
    """Turns raw video by quarter turns, or mirrors it.

    Registration, detections and tracks turn with the pixels. The field of view and the corners of a pose are
    left out, because they are those of the frame as it was taken. `decode` turns video by its rotation mark.

    Example:
        videotestsrc num-buffers=5 ! videoflip video-direction=180 ! fakesink
    """

    sink = src = f"video/x-raw, format={{ {', '.join(FORMATS)} }}"
    keeps_view = False

    video_direction: VideoDirection = Property(
        VideoDirection.IDENTITY,
        aliases=("method",),
        doc="Quarter turn (90r is clockwise) or mirror image; or the words of GStreamer's older `method`.",
    )

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any or not swaps_sides(self.video_direction):
            return caps
        return Caps([_turned(structure) for structure in caps.structures])

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._format = str(sink_caps["format"])
        size = sink_caps.integer("width"), sink_caps.integer("height")
        self.mapping = flip_homography(self.video_direction, size)

    @override
    def transform(self, frame: Frame) -> Frame:
        if self.video_direction is VideoDirection.IDENTITY:
            return self.reframed(frame, None)
        return self.reframed(frame, flip_image(frame.data, self._format, self.video_direction))


def _turned(structure: Structure) -> Structure:
    """Caps with width and height, and the shape of a pixel, of a quarter turn."""
    fields = dict(structure.fields)
    sides = {"width": fields.pop("height", None), "height": fields.pop("width", None)}
    fields |= {name: value for name, value in sides.items() if value is not None}
    return Structure(structure.name, fields, structure.features)
