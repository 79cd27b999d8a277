"""dronetestsrc: renders aerial video with exact ground truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from importlib.resources import as_file, files
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import Caps, Frame, Property, ResourceError, SettingsOf, Source
from streamkit_video.dronetestsrc.world import World, WorldSettings
from streamkit_video.videoconvert import choose_format

PREFERRED = Caps("video/x-raw, width=1280, height=720, framerate=25/1")
RATE_WITHOUT_FRAMERATE = Fraction(25)


class DroneTestSrc(Source):
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

    num_buffers: int = Property(-1, min=-1, doc="Frames before EOS; -1 is endless.")
    location: str | None = Property(
        None, file="read", doc="Image of the ground; the aerial photograph shipped with the plugin if unset."
    )
    settings = SettingsOf(WorldSettings)
    is_live: bool = Property(False, doc="Pace the frames in real time, as a camera does.")

    _ground: NDArray[np.uint8] | None = None

    @override
    def start(self) -> None:
        try:
            self._ground = load_ground(self.location)
        except OSError as error:
            raise ResourceError(f"{self.name}: location: {error}") from error

    @override
    def stop(self) -> None:
        self._ground = None

    @override
    def negotiate(self, allowed: Caps) -> Caps:
        """The nearest to 1280x720 at 25 frames a second."""
        return choose_format(allowed, PREFERRED, self.name)

    @override
    def frames(self) -> Iterator[Frame]:
        caps = self.src_caps
        rate = caps["framerate"]
        pace = rate if isinstance(rate, Fraction) and rate > 0 else RATE_WITHOUT_FRAMERATE
        world = self._make_world(caps, float(pace))
        began_ns, count = self.clock_ns(), 0
        while self.num_buffers < 0 or count < self.num_buffers:
            pts, end = (int(number * 1_000_000_000 / pace) for number in (count, count + 1))
            if self.is_live and not self.clock.wait_until(began_ns + pts, self.over):
                return
            if self.src_caps is not caps:  # renegotiated: a new flight begins
                caps = self.src_caps
                world = self._make_world(caps, float(pace))
            yield _next_frame(world, caps).replace(pts=pts, duration=end - pts)
            count += 1

    def _make_world(self, caps: Caps, frame_rate: float) -> World:
        ground = self._ground
        if ground is None:
            raise ResourceError(f"{self.name}: has no image of the ground before it is started")
        if caps["format"] == "GRAY8":
            ground = np.asarray(cv2.cvtColor(ground, cv2.COLOR_BGR2GRAY), np.uint8)
        settings = dataclasses.replace(self.settings, frame_rate=frame_rate)
        try:
            return World(ground, (caps.integer("width"), caps.integer("height")), settings)
        except ValueError as error:
            raise ResourceError(f"{self.name}: {error}") from error


def _next_frame(world: World, caps: Caps) -> Frame:
    rendered = world.next_frame()
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
