"""multifilesrc: numbered image files, as coded packets."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from os import R_OK, X_OK, access
from os.path import exists  # unlike Path's, False where a name is too long or a folder is closed
from pathlib import Path

from streamkit import SECOND_NS, Caps, Capture, Frame, FrameFlags, Property, ResourceError, Source
from streamkit.output.names import FileNames, local_path
from streamkit_media.codecs import CODED_CAPS, video_caps
from streamkit_media.container import open_container, video_stream
from streamkit_media.files.completeness import is_cut_short
from streamkit_telemetry_formats.photograph import sample_of_photograph

NUMBER = re.compile(r"%0?\d*d")


class MultiFileSrc(Source):
    """Reads numbered image files as one video, up to the first number that is missing.

    A missing number with files after it, or before `stop-index`, is warned of, as a shortfall. A photograph
    with a position (Exif, DJI's XMP) gets a `Pose`, and one that is cut short is marked as `CORRUPT`.

    Example:
        multifilesrc location=img/%06d.jpg start-index=1 framerate=25/1 ! decode ! fakesink
    """

    src = CODED_CAPS

    location: str = Property("", file="read", doc="Path with a number: img/%06d.jpg.")
    start_index: int = Property(0, min=0, doc="First number.")
    stop_index: int = Property(-1, min=-1, doc="Last number; -1 is the last before the first gap.")
    framerate: Fraction = Property(Fraction(25), min=Fraction(1, 3600), doc="Frames per second.")
    loop: bool = Property(False, doc="Repeat forever.")

    def start(self) -> None:
        """Opens the first file, so that a bad one fails before playing."""
        if len(NUMBER.findall(self.location)) != 1 or self.location.replace("%%", "").count("%") != 1:
            raise ResourceError(
                f"location={self.location!r} must hold one number; write location=img/%06d.jpg"
            )
        if -1 < self.stop_index < self.start_index:
            raise ResourceError(
                f"stop-index={self.stop_index} must not be below start-index={self.start_index}"
            )
        first = str(self._path(self.start_index))
        if not exists(first) and (numbers := list(self._numbers_there())):
            raise ResourceError(f"{first} is not there; the files begin with start-index={min(numbers)}")
        with open_container(first) as container:
            self._caps = video_caps(video_stream(container, first)).with_fields(framerate=self.framerate)

    def _numbers_there(self) -> Iterator[int]:
        """Numbers of the files there are, in any order."""
        files = FileNames(self.location).existing() if access(self._path(0).parent, R_OK | X_OK) else ()
        return (number for _, number in files if exists(self._path(number)))

    def _warn_of_gap(self, missing: int) -> None:
        """Warns if the video ends at a missing number though more files are there, or are asked for."""
        if -1 < self.stop_index < missing:
            return
        numbers = [number for number in self._numbers_there() if number > missing]
        if self.stop_index > -1:
            numbers = [number for number in numbers if number <= self.stop_index]
        if not numbers and self.stop_index < 0:
            return
        wanted = "" if self.stop_index < 0 else f" up to stop-index={self.stop_index}"
        following = f"{len(numbers)} files that come after it{wanted} are not read"
        rest = (
            f"{following}; go on with start-index={min(numbers)}" if numbers else f"no file follows{wanted}"
        )
        self.post_warning(f"{self._path(missing)} is missing, the video ends before it: {rest}", "shortfall")

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps of the first file."""
        return self._caps

    def frames(self) -> Iterator[Frame]:
        """One packet for each file.

        Raises:
            ResourceError: a file is there but cannot be read.
        """
        count, index = 0, self.start_index
        while True:
            data = self._read(index)
            if data is None:
                if count == index - self.start_index:  # the first round
                    self._warn_of_gap(index)
                if not self.loop or index == self.start_index:
                    return
                index = self.start_index
                continue
            pts, end = self._time_ns(count), self._time_ns(count + 1)
            flags = FrameFlags.KEYFRAME
            if is_cut_short(data):
                flags |= FrameFlags.CORRUPT
                self.warn_once(f"{self._path(index)} is cut short, and part of its picture grey", "cut short")
            frame = Frame(data, self._caps, pts=pts, duration=end - pts, flags=flags)
            yield with_pose(frame, data)
            count, index = count + 1, index + 1

    def _time_ns(self, count: int) -> int:
        """When image number `count` begins; the product is rounded, not summed, so that nothing drifts."""
        return round(count * SECOND_NS / self.framerate)

    def _read(self, index: int) -> bytes | None:
        if -1 < self.stop_index < index:
            return None
        path = self._path(index)
        try:
            return path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise ResourceError(
                f"{path}: cannot be read: {error.strerror}; check the file and its rights"
            ) from None

    def _path(self, index: int) -> Path:
        return local_path(self.location % index)


def with_pose(frame: Frame, data: bytes) -> Frame:
    """A frame with the pose and time that its file holds."""
    sample = sample_of_photograph(data, frame.pts or 0)
    if sample is None:
        return frame
    frame = frame.attach(sample.pose, sample)
    return frame if sample.utc_ns is None else frame.replace(capture=Capture(sample.utc_ns, "file"))
