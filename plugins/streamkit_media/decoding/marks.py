"""State that lasts from frame to frame of a live or damaged stream: damage and age."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

# Frames that depend on a damaged one are damaged, too, until a keyframe; streams without one heal in time.
DAMAGE_LASTS = 300
LOST_END_PACKETS = 10  # more than a file that is cut short loses
# No codec holds more frames back.
PENDING_LIMIT = 256
WINDOW = 32
FIRST_DELAY_NS = 50_000_000
MIN_GAIN_NS = 5_000_000


class Damage:
    """Damage of frames, which outlasts the packet that it began with until it heals."""

    def __init__(self) -> None:
        self._failed = 0  # packets since the last frame
        self._failed_from = 0, ""  # the number of the first of them, and it in words
        self._frames_left = 0

    def begin(self, number: int, packet: str) -> None:
        """Marks the frames that follow as damaged: a packet, of this number, that they depend on is lost."""
        self._frames_left = DAMAGE_LASTS
        self._failed_from = self._failed_from if self._failed else (number, packet)
        self._failed += 1

    def next_frame(self, number: int, *, is_corrupt: bool, is_key: bool) -> bool:
        """Whether the frame of a packet, or one that it depends on, is damaged; a keyframe has none."""
        if number > self._failed_from[0]:  # it may have been held, for its order
            self._failed = 0
        if is_corrupt:
            self._frames_left = DAMAGE_LASTS
        elif self._frames_left:
            self._frames_left = 0 if is_key else self._frames_left - 1
        return self._frames_left > 0

    def lost_end(self) -> str:
        """A warning if the last packets gave no frame, else ""."""
        if self._failed < LOST_END_PACKETS:
            return ""
        return (
            f"the last {self._failed} packets gave no frame, from {self._failed_from[1]} on; where "
            "recordings of different codecs are joined, read them one by one"
        )


@dataclass(frozen=True, slots=True)
class Freshness:
    """Metadata of a live packet: its frame is shown soon or not at all."""

    slack_ns: int  # by how much the frame's age may exceed the inherent delay


class InherentDelay:
    """Estimates the delay that every frame has, and finds frames that have waited in addition.

    The age of a frame is that of the packet which let the decoder give it out. The minimum age of the last
    32 frames is the inherent delay, the time that decoding takes. Older frames have waited; they are dropped
    only while that makes the next one younger.
    """

    def __init__(self) -> None:
        self._ages = deque([FIRST_DELAY_NS] * WINDOW, WINDOW)
        self._dropped_age_ns: int | None = None

    def add(self, age_ns: int) -> None:
        """Adds the age of a frame that is not shown for another reason."""
        self._ages.append(age_ns)

    def drops(self, age_ns: int, slack_ns: int) -> bool:
        """Decides on the next frame, and adds its age: one older than the delay and the slack is dropped."""
        self._ages.append(age_ns)
        if self._dropped_age_ns is None:
            is_dropped = age_ns - min(self._ages) > slack_ns
        else:
            is_dropped = self._dropped_age_ns - age_ns > MIN_GAIN_NS
        self._dropped_age_ns = age_ns if is_dropped else None
        return is_dropped
