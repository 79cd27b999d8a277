"""dronetestsrc: renders aerial video with exact ground truth."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from fractions import Fraction
from importlib.resources import as_file, files
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import Caps, Frame, Property, ResourceError, SettingsOf
from streamkit_video.dronetestsrc.world import World, WorldSettings
from streamkit_video.paced_source import PacedSource


class DroneTestSrc(PacedSource):
    """A drone's view of moving cars, with the true homographies and car positions of every frame.

    Frames carry `streamkit_video.TrueRegistration` and `streamkit_video.TrueTargets`. The same properties and
    caps give the same frames, bit for bit. Motion is per frame at any frame rate.

    Example:
        dronetestsrc num-buffers=5 ! fakesink
    """

    src = (
        "video/x-raw, format={ GRAY8, I420, BGR }, width=[ 16, 8192 ], height=[ 16, 8192 ], "
        "framerate=[ 0/1, 1000/1 ]"
    )

    preferred = Caps("video/x-raw, width=1280, height=720, framerate=25/1")

    location: str | None = Property(
        None, file="read", doc="Image of the ground; the aerial photograph shipped with the plugin if unset."
    )
    settings = SettingsOf(WorldSettings)

    @override
    def start(self) -> None:
        try:
            self._ground = load_ground(self.location)
        except OSError as error:
            raise ResourceError(f"{self.name}: location: {error}") from error

    @override
    def begin_format(self, caps: Caps, pace: Fraction, start_ns: int) -> None:
        """Begins a flight."""
        ground = self._ground
        if caps["format"] == "GRAY8":
            ground = np.asarray(cv2.cvtColor(ground, cv2.COLOR_BGR2GRAY), np.uint8)
        settings = dataclasses.replace(self.settings, frame_rate=float(pace))
        try:
            self._world = World(ground, (caps.integer("width"), caps.integer("height")), settings)
        except ValueError as error:
            raise ResourceError(f"{self.name}: {error}") from error

    @override
    def next_frame(self, caps: Caps) -> Frame:
        rendered = self._world.next_frame()
        is_planar = caps["format"] == "I420"
        data = cv2.cvtColor(rendered.image, cv2.COLOR_BGR2YUV_I420) if is_planar else rendered.image
        return Frame(data, caps).attach(rendered.registration, rendered.targets)


def load_ground(location: str | None) -> NDArray[np.uint8]:
    """Reads the image that the camera flies over.

    Args:
        location: path of an image; None for the aerial photograph shipped with the plugin.

    Returns:
        uint8[h, w, 3], BGR.

    Raises:
        OSError: the file does not exist or is no image.
    """
    if location is not None:
        return _read(Path(location))
    with as_file(files("streamkit_video") / "data" / "aerial.jpg") as shipped:
        return _read(shipped)


def _read(path: Path) -> NDArray[np.uint8]:
    content = np.frombuffer(path.read_bytes(), np.uint8)
    image = None
    if content.size:
        with suppress(cv2.error):
            image = cv2.imdecode(content, cv2.IMREAD_COLOR_BGR)
    if image is None:
        raise OSError(f"{path}: OpenCV cannot read it as an image; give a JPEG or PNG file")
    return np.asarray(image, np.uint8)
