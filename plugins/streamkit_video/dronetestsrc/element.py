"""dronetestsrc: a drone's video with exact truth."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit import Caps, Frame, Property, ResourceError, Source
from streamkit_video.dronetestsrc.ground import load_ground
from streamkit_video.dronetestsrc.world import World, WorldSettings
from streamkit_video.raw_caps import choose_format, formats_in

PREFERRED = Caps("video/x-raw, width=1280, height=720, framerate=25/1")
PACE_OF_VARIABLE_RATE = Fraction(25)


class DroneTestSrc(Source):
    """A drone's view of moving cars, with the true homographies and car positions of every frame.

    Frames carry `streamkit_video.TrueRegistration` and `streamkit_video.TrueTargets`. The same properties and
    caps give the same frames, bit for bit. Motion is per frame, whatever the frame rate.

    Example:
        dronetestsrc num-buffers=5 ! fakesink
    """

    src = (
        "video/x-raw, format={ GRAY8, I420, BGR }, width=[ 16, 8192 ], height=[ 16, 8192 ], "
        "framerate=[ 0/1, 1000/1 ]"
    )

    num_buffers: int = Property(-1, min=-1, doc="Frames before EOS; -1 is endless.")
    location: str | None = Property(
        None, doc="Picture of the ground; the aerial photograph shipped with the plugin if unset."
    )
    cars: int = Property(12, min=0, max=200, doc="Cars that drive below the camera.")
    seed: int = Property(0, min=0, doc="Another seed is another flight with other cars.")
    noise: float = Property(
        2.0, min=0.0, max=40.0, unit="grey levels", doc="Standard deviation of the noise of the sensor."
    )
    jitter: float = Property(
        0.5, min=0.0, max=20.0, unit="px", doc="Standard deviation of the camera's shake from frame to frame."
    )
    speed: float = Property(
        4.0,
        min=0.0,
        max=40.0,
        unit="px/frame",
        doc="Top speed of the camera along either axis of the ground.",
    )
    is_live: bool = Property(False, doc="Pace the frames in real time, as a camera would.")

    def start(self) -> None:
        """Reads the picture of the ground."""
        try:
            self._ground: NDArray[np.uint8] | None = load_ground(self.location)
        except OSError as error:
            raise ResourceError(f"{self.name}: location: {error}") from error

    def stop(self) -> None:
        """Lets go of the picture."""
        self._ground = None

    def negotiate(self, allowed: Caps) -> Caps:
        """1280x720 at 25 frames a second, or what is nearest to it."""
        return choose_format(allowed, tuple(formats_in(allowed)), PREFERRED, self.name)

    def frames(self) -> Iterator[Frame]:
        """Renders frame after frame."""
        caps = self.src_caps
        rate = caps["framerate"]
        pace = rate if isinstance(rate, Fraction) and rate > 0 else PACE_OF_VARIABLE_RATE
        world = self._make_world(caps, float(pace))
        planar = caps["format"] == "I420"
        began_ns, count = self.clock_ns(), 0
        while self.num_buffers < 0 or count < self.num_buffers:
            pts, end = (int(number * 1_000_000_000 / pace) for number in (count, count + 1))
            if self.is_live and not self.clock.wait_until(began_ns + pts, self.over):
                return
            if self.src_caps is not caps:  # another format was agreed on: another flight begins
                caps, planar = self.src_caps, self.src_caps["format"] == "I420"
                world = self._make_world(caps, float(pace))
            yield _next_frame(world, planar, caps).replace(pts=pts, duration=end - pts)
            count += 1

    def _make_world(self, caps: Caps, frame_rate: float) -> World:
        ground = self._ground
        if ground is None:
            raise ResourceError(f"{self.name}: has no picture of the ground before it is started")
        if caps["format"] == "GRAY8":
            ground = np.asarray(cv2.cvtColor(ground, cv2.COLOR_BGR2GRAY), np.uint8)
        settings = WorldSettings(self.cars, self.seed, self.noise, self.jitter, self.speed, frame_rate)
        try:
            return World(ground, (caps.integer("width"), caps.integer("height")), settings)
        except ValueError as error:
            raise ResourceError(f"{self.name}: {error}") from error


def _next_frame(world: World, planar: bool, caps: Caps) -> Frame:
    rendered = world.next_frame()
    data = cv2.cvtColor(rendered.picture, cv2.COLOR_BGR2YUV_I420) if planar else rendered.picture
    return Frame(data, caps).attach(rendered.registration, rendered.targets)
