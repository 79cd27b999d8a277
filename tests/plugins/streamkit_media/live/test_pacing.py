import threading
from fractions import Fraction

import av
import pytest

from streamkit_media.live.liveinput import paced


class FakeTime(threading.Event):
    """A clock that a wait moves on."""

    now_s = 100.0

    def wait(self, timeout: float | None = None) -> bool:
        """Passes the time; never set."""
        self.now_s += timeout or 0.0
        return self.is_set()


def packet(seconds: float | None) -> av.Packet:
    """A packet that is decoded at a time."""
    made = av.Packet(b"x")
    made.time_base = Fraction(1, 90_000)
    made.dts = None if seconds is None else round(seconds * 90_000)
    return made


def passed_at(times: list[float | None], hold: dict[int, float] | None = None) -> list[float]:
    """When packets that are all there pass; `hold` is how late each comes."""
    clock = FakeTime()

    def arriving():
        for index, seconds in enumerate(times):
            clock.now_s += (hold or {}).get(index, 0.0)
            yield packet(seconds)

    return [clock.now_s - 100.0 for _ in paced(arriving(), clock, lambda: clock.now_s)]


def test_a_burst_is_played_in_real_time() -> None:
    """Packets pass as far apart as they are decoded; those without a time pass at once."""
    assert passed_at([7.0, 7.04, None, 7.08, 7.5]) == pytest.approx([0, 0.04, 0.04, 0.08, 0.5])


def test_a_late_packet_is_followed_by_no_burst() -> None:
    """What comes too late moves the times of all after it."""
    assert passed_at([0.0, 0.1, 0.2, 0.3], {1: 2.0}) == pytest.approx([0, 2.0, 2.1, 2.2])


def test_a_jump_is_not_waited_for() -> None:
    """A step of the times of an hour, in either direction, passes at once."""
    assert passed_at([0.0, 3600.0, 3600.1, 5.0, 5.1]) == pytest.approx([0, 0, 0.1, 0.1, 0.2])


def test_an_end_ends_the_packets() -> None:
    """Once the event is set, the wait and the packets end."""
    ended = threading.Event()
    packets = paced(iter([packet(0.0), packet(0.9), packet(1.0)]), ended)
    next(packets)
    ended.set()
    assert list(packets) == []
