"""Timestamps over several connections, whose senders count from anywhere."""

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
        own = self._own_time(arrival_ns) if pts is None else pts
        if self._offset is None or self._leaps(own, arrival_ns):
            self._offset = max(arrival_ns - self._zero, self._highest + STEP_NS) - own
        self._before = (own, arrival_ns)
        placed = own + self._offset
        self._highest = max(self._highest, placed)
        return placed

    def _own_time(self, arrival_ns: int) -> int:
        return 0 if self._offset is None else self._before[0] + arrival_ns - self._before[1]

    def _leaps(self, own: int, arrival_ns: int) -> bool:
        step = own - self._before[0]
        return abs(step) > LEAP_NS and abs(step - (arrival_ns - self._before[1])) > LEAP_NS
