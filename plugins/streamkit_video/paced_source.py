"""Base class of sources that make frames of any number, at any rate."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from fractions import Fraction
from typing import ClassVar

from typing_extensions import override

from streamkit import SECOND_NS, Caps, Capture, Frame, Property, Source
from streamkit_video.videoconvert import choose_format

WINDOW_NS = 3 * SECOND_NS  # over which the rate of live frames is watched
SLOWEST = 0.8  # of the rate


class PacedSource(Source):
    """Numbers and times frames, and begins anew where another format is negotiated.

    Attributes:
        preferred: format to which the nearest is negotiated; its frame rate also holds where there is none.
    """

    preferred: ClassVar[Caps]

    num_buffers: int = Property(-1, min=-1, max=2**31 - 1, doc="Frames before EOS; -1 is endless.")
    is_live: bool = Property(
        False, doc="Pace the frames in real time, as a camera does, and give them a time of capture."
    )

    def begin_format(self, caps: Caps, pace: Fraction, start_ns: int) -> None:
        """Prepares frames of a format from a running time on, ns; `pace` is in frames per second."""
        raise NotImplementedError

    def next_frame(self, caps: Caps) -> Frame:
        """The next frame of the format, without times."""
        raise NotImplementedError

    @override
    def negotiate(self, allowed: Caps) -> Caps:
        return choose_format(allowed, self.preferred, self.name)

    @override
    def duration_ns(self) -> int | None:
        rate = self.src_caps.get("framerate")
        if self.num_buffers < 0 or not isinstance(rate, Fraction) or rate <= 0:
            return None
        return int(self.num_buffers * SECOND_NS / rate)

    @override
    def frames(self) -> Iterator[Frame]:
        began_ns, end_ns, number = self.clock_ns(), 0, 0
        window = 0, self.timing.running_time_ns()
        caps: Caps | None = None
        for count in itertools.count():
            if count == self.num_buffers:
                return
            if self.src_caps is not caps:
                caps, start_ns, number = self.src_caps, end_ns, 0
                rates = caps["framerate"], self.preferred["framerate"]
                pace = next(rate for rate in rates if isinstance(rate, Fraction) and rate > 0)
                self.begin_format(caps, pace, start_ns)
            pts, end_ns = (start_ns + int(n * SECOND_NS / pace) for n in (number, number + 1))
            if self.is_live and not self.clock.wait_until(began_ns + pts, self.over):
                return
            # Rendering takes the time between capture and arrival.
            capture = Capture(self.clock.utc_ns(), "arrival") if self.is_live else None
            yield self.next_frame(caps).replace(pts=pts, duration=end_ns - pts, capture=capture)
            number += 1
            if self.is_live:
                window = self._watch_rate(end_ns, pace, window)

    def _watch_rate(self, end_ns: int, pace: Fraction, window: tuple[int, int]) -> tuple[int, int]:
        """Warns once where live frames are made too slowly over a window, which begins at these two times."""
        now_ns = self.timing.running_time_ns()
        if now_ns - window[1] < WINDOW_NS:
            return window
        share = (end_ns - window[0]) / (now_ns - window[1])
        if share < SLOWEST:
            self.warn_once(
                f"makes {share * pace:.0f} of {pace} frames/s: this machine does not keep up; put a queue "
                "behind it, or ask for a smaller size or rate",
                "rate",
            )
        return end_ns, now_ns
