"""hudmask: marks the pixels of overlaid graphics, which do not show the scene."""

from __future__ import annotations

import re

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import Caps, Frame, HiddenPixels, Property, ResourceError, Transform
from streamkit_kernels.mask_image import read_mask
from streamkit_video.pixel_formats import ANY_FORMAT

Mask = NDArray[np.uint8]
SIDES = 4
RELATIVE = 1.0
EXAMPLE = 'areas="0,0,1,0.08; 20,400,180,60"'


class HudMask(Transform):
    """Marks overlaid graphics (HUD, logo, time stamp), so that later elements leave them out.

    Pixels pass unchanged. There `framediff` detects and learns nothing, `stitch` does not register by them,
    and its mosaic shows other frames. Other elements see the graphics: draw with `trackoverlay` as usual.

    Example:
        videotestsrc num-buffers=40 ! clockoverlay ! hudmask areas=0,0,1,0.15 ! stitch ! framediff ! fakesink
    """

    sink = src = ANY_FORMAT

    areas: str = Property(
        "",
        doc="Rectangles 'x,y,width,height; ...' in px, or shares of the frame where no number exceeds 1.",
    )
    location: str = Property(
        "", file="read", doc="Image that is white where graphics are; it is scaled to the frame."
    )
    margin: int = Property(
        2, min=0, max=64, unit="px", doc="Around each of them: compression smears their edges."
    )

    @override
    def start(self) -> None:
        try:
            if not self.areas.strip() and not self.location:
                raise ValueError(f"areas= or location= must say where the graphics are; write {EXAMPLE}")
            rectangles(self.areas, 1, 1)  # of the text, before the size is known
            self._image = read_mask(self.location) if self.location else None
        except ValueError as error:
            raise ResourceError(f"{self.name}: {error}") from None

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._hidden = HiddenPixels(self._mask(sink_caps.integer("width"), sink_caps.integer("height")))
        self._hidden.mask.flags.writeable = False

    @override
    def transform(self, frame: Frame) -> Frame:
        return frame.attach(self._hidden)

    def _mask(self, width: int, height: int) -> Mask:
        """The mask for frames of a size, px."""
        mask = np.zeros((height, width), np.uint8)
        for left, top, right, bottom in rectangles(self.areas, width, height):
            mask[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = 255
        if self._image is not None:
            image = cv2.resize(self._image, (width, height), interpolation=cv2.INTER_NEAREST)
            mask |= np.asarray(image, np.uint8)
        side = 2 * self.margin + 1
        return np.asarray(cv2.dilate(mask, np.ones((side, side), np.uint8)), np.uint8)


def rectangles(text: str, width: int, height: int) -> list[tuple[int, int, int, int]]:
    """Left, top, right, bottom (exclusive), px, of the rectangles in a text for frames of a size, px.

    Raises:
        ValueError: it holds something else.
    """
    found = []
    for part in filter(str.strip, text.split(";")):
        words = re.split(r"[\s,]+", part.strip())
        try:
            numbers = np.array([float(word) for word in words])
        except ValueError:
            numbers = np.empty(0)
        if len(numbers) != SIDES or not np.isfinite(numbers).all() or (numbers < 0).any():
            raise ValueError(f"areas: {part.strip()!r} must be x,y,width,height from 0; write {EXAMPLE}")
        if numbers.max() <= RELATIVE:
            numbers = numbers * (width, height, width, height)
        left, top, across, down = np.minimum(numbers, width + height)
        found.append((int(left), int(top), int(np.ceil(left + across)), int(np.ceil(top + down))))
    return found
