"""OpenCV's MOG2 and KNN as they do best: settings of their own for each scene, on a registered canvas.

On a moving camera they are given what framediff does without: a canvas made beforehand for the whole flight,
so that nothing ever leaves it. What the frame does not cover is given to them as known foreground, which they
do not learn; ground that has just come into view counts as ground for some frames.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from streamkit import Registration
from streamkit_differencer.objects import find_objects
from streamkit_differencer.sampling import downsampled
from streamkit_differencer.settings import ObjectSettings

ByteImage = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float64]

# The outermost pixels of a warped frame mix with what lies outside it.
BORDER_PX = 2


@dataclass(frozen=True)
class PeerSettings:
    """How a peer is set.

    Attributes:
        name: MOG2 or KNN.
        history: frames.
        threshold: squared distance in standard deviations (MOG2, varThreshold) or grey levels (KNN,
            dist2Threshold).
        learning_rate: per frame; -1 goes by the history.
        median: width of the median filter, working px; 0 is none.
        new_frames: frames for which ground counts as such after it came into view.
        min_area: cells of 4 by 4 px that an object must have.
        scale: frame pixels per working pixel.
    """

    name: str
    history: int
    threshold: float
    learning_rate: float = -1.0
    median: int = 3
    new_frames: int = 15
    min_area: int = 3
    scale: int = 2

    def subtractor(self) -> cv2.BackgroundSubtractor:
        """A new one."""
        make = {"MOG2": cv2.createBackgroundSubtractorMOG2, "KNN": cv2.createBackgroundSubtractorKNN}
        return make[self.name](self.history, self.threshold, detectShadows=False)


@dataclass(frozen=True, eq=False)
class Canvas:
    """A canvas around the frames of a whole flight.

    Attributes:
        places: float64[3, 3] of each frame, working pixels to canvas.
        size: width and height, px.
    """

    places: list[FloatArray]
    size: tuple[int, int]

    @classmethod
    def around(cls, registrations: list[Registration], size: tuple[int, int], scale: int) -> "Canvas":
        """The canvas of a flight whose frames have a size, width and height, working px."""
        offset = (scale - 1) / 2
        grid = np.array([[scale, 0, offset], [0, scale, offset], [0, 0, 1.0]])
        # The plane may move on the way; all frames are placed on the first one.
        to_first, first, places = np.eye(3), None, []
        for registration in registrations:
            if registration.reference_change is not None:
                to_first = to_first @ np.linalg.inv(registration.reference_change)
            on_plane = to_first @ registration.to_reference @ grid
            first = on_plane if first is None else first
            places.append(np.linalg.inv(first) @ on_plane)
        width, height = size
        outline = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], np.float64)
        corners = np.concatenate([cv2.perspectiveTransform(outline, place)[0] for place in places])
        low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
        shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]])
        extent = int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1
        return cls([shift @ place for place in places], extent)


@dataclass(eq=False)
class Peer:
    """A subtractor of OpenCV, on a canvas where it is given one.

    Attributes:
        settings: how it is set.
        canvas: of the flight; None to take the frames as they are.
    """

    settings: PeerSettings
    canvas: Canvas | None = None
    _subtractor: cv2.BackgroundSubtractor = field(init=False)
    _views: ByteImage | None = None
    _frame: int = 0

    def __post_init__(self) -> None:
        self._subtractor = self.settings.subtractor()

    def update(self, picture: ByteImage, _: Registration | None) -> tuple[ByteImage, FloatArray]:
        """Mask at the working scale, and centroids in pixels of the frame."""
        working = downsampled(picture, self.settings.scale)
        if self.canvas is None:
            mask = self._subtractor.apply(working, learningRate=self.settings.learning_rate)
        else:
            mask = self._on_canvas(working, self.canvas.places[self._frame], self.canvas.size)
        self._frame += 1
        if self.settings.median:
            mask = cv2.medianBlur(mask, self.settings.median)
        objects = find_objects(
            mask, self.settings.scale, ObjectSettings(min_area=self.settings.min_area, max_objects=1000)
        )
        return mask, objects.centroids

    def _on_canvas(self, working: ByteImage, place: FloatArray, size: tuple[int, int]) -> ByteImage:
        warped = cv2.warpPerspective(working, place, size, borderMode=cv2.BORDER_REPLICATE)
        inner = np.zeros_like(working)
        inner[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = 255
        seen = cv2.warpPerspective(inner, place, size, flags=cv2.INTER_NEAREST)
        found = self._subtractor.apply(
            warped, knownForegroundMask=~seen, learningRate=self.settings.learning_rate
        )
        if self._views is None:
            self._views = np.zeros_like(seen)
        self._views = cv2.add(self._views, seen & np.uint8(1))
        found = np.where((self._views > self.settings.new_frames) & (seen > 0), found, np.uint8(0))
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpPerspective(found, place, working.shape[::-1], flags=flags))
