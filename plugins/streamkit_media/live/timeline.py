"""Timeline: the timestamps of a live stream, over all its connections."""

from __future__ import annotations

LEAP_NS = 10_000_000_000  # the server's clock was set, or its counter restarted
STEP_NS = 1_000_000


class Timeline:
    """Keeps the server's time steps within a connection, and the arrival times between two."""

    def __init__(self) -> None:
        self._zero: int | None = None
        self._offset: int | None = None
        self._highest = -STEP_NS
        self._before = (0, 0)

    def begin_connection(self) -> None:
        """The server's times restart."""
        self._offset = None

    def place(self, pts: int | None, arrival_ns: int) -> int:
        """The timestamp of a packet.

        Args:
            pts: the server's time, ns; where it is None, 0 for the first packet, by arrival for others.
            arrival_ns: monotonic clock, ns.

        Returns:
            ns since the first packet arrived; higher than all of the connections before.
        """
        if self._zero is None:
            self._zero = arrival_ns
        before, elapsed_ns = self._before[0], arrival_ns - self._before[1]
        if pts is None:
            pts = 0 if self._offset is None else before + elapsed_ns
        step = pts - before
        leaps = abs(step) > LEAP_NS and abs(step - elapsed_ns) > LEAP_NS
        if self._offset is None or leaps:
            self._offset = max(arrival_ns - self._zero, self._highest + STEP_NS) - pts
        self._before = (pts, arrival_ns)
        self._highest = max(self._highest, pts + self._offset)
        return pts + self._offset
