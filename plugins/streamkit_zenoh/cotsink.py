"""cotsink: targets with a place on the ground as Cursor-on-Target events, for TAK."""

import threading

from streamkit import Frame, Property, ResourceError, Sink
from streamkit_zenoh.export.cursor_on_target import EventSender, InvalidAddress, events
from streamkit_zenoh.publish.line import SendingLine
from streamkit_zenoh.wire.records import plain_record

STOP_LIMIT_S = 2.0


class CotSink(Sink):
    """Sends each confirmed target whose place on the ground is known as a Cursor-on-Target event.

    Over UDP, multicast too, or TCP, from a thread of its own: what does not fit is dropped and counted, a TCP
    server that goes away is connected to again. Places come with the records, or from pose and
    ground-altitude.

    Example:
        zenohsrc key=uav/1 timeout-s=10 ! cotsink address=udp://239.2.3.1:6969
    """

    sink = "video/x-raw; application/x-tracks"
    address: str = Property("udp://239.2.3.1:6969", doc="Where to: udp://HOST:PORT or tcp://HOST:PORT.")
    source: str = Property("streamkit", doc="Source named in the events of frames that are no records.")
    cot_type: str = Property("a-u-G", doc="Type of the events in the CoT hierarchy.")
    stale_s: float = Property(5.0, min=0.1, unit="s", doc="How long an event holds.")
    interval_s: float = Property(1.0, min=0.0, unit="s", doc="Least time between two events of all targets.")
    ground_altitude: float | None = Property(
        None, unit="m", doc="Of the ground, counted as the poses count it."
    )
    max_queue: int = Property(64, min=1, doc="Records that may wait to be sent.")

    _line: SendingLine[list[bytes]] | None = None
    _sender: EventSender | None = None

    def start(self) -> None:
        """Opens the link."""
        self._line = self._sender = None
        self._warned = False
        self._next_ns = 0
        self._never = threading.Event()
        try:
            self._sender = EventSender(self.address)
        except InvalidAddress as error:
            raise ResourceError(str(error)) from None
        except OSError as error:
            raise ResourceError(
                f"address={self.address}: {error}; start the server or name another"
            ) from error
        self._line = SendingLine(self._send, self.max_queue, self._failed)

    def render(self, frame: Frame) -> None:
        """Lines up the events of a frame, when they are due."""
        assert self._line is not None, "start() comes before frames"
        now_ns = self.clock_ns()
        if now_ns < self._next_ns:
            return
        record = plain_record(frame, self.source, self.clock.utc_ns(), self.ground_altitude)
        found = list(events(record, self.cot_type, self.stale_s))
        if not found:
            self.count_drop("no target with a place")
            return
        self._next_ns = now_ns + round(self.interval_s * 1e9)
        dropped = self._line.submit(found, 0.0, self._never)
        if dropped:
            self.count_drop("queue full", dropped)

    def drain(self) -> None:
        """Sends what waits."""
        if self._line is not None:
            left = self._line.flush(STOP_LIMIT_S, self.stopping)
            if left:
                self.count_drop("not sent before the end", left)

    def stop(self) -> None:
        """Closes the link."""
        line, sender = self._line, self._sender
        self._line = self._sender = None
        if line is not None:
            line.close()
            line.join(STOP_LIMIT_S)
        if sender is not None:
            sender.close()

    def _send(self, found: list[bytes]) -> None:
        sender = self._sender
        if sender is not None:
            for event in found:
                sender.send(event)

    def _failed(self, error: Exception) -> None:
        self.count_drop("not sent")
        if not self._warned and not self.stopping.is_set():
            self._warned = True
            self.post_warning(f"events to {self.address} are not sent: {error}; trying on")
