"""zenohsink: publishes the tracks of each frame."""

import threading
from collections.abc import Callable

import zenoh

from streamkit import Flushing, Frame, Property, ResourceError, Sink
from streamkit_zenoh.connection import Connection
from streamkit_zenoh.keys import InvalidKey, publication_key
from streamkit_zenoh.presence import show_publisher, wait_for_receivers, watch_receivers
from streamkit_zenoh.records import payload_of
from streamkit_zenoh.sender import RecordSender
from streamkit_zenoh.session import close_session, plain

# At the end of the stream zenoh may take its time to hand over the last records; a stop may not.
FINISH_LIMIT_S = 12.0
STOP_LIMIT_S = 3.0


class ZenohSink(Connection, Sink):
    """Publishes one JSON record per frame at KEY/tracks, reliably and in order.

    Records go through a bounded line of their own, so that a slow receiver does not hold up the pipeline;
    what is dropped there is counted, and told in the next record. Without connect and listen, receivers on
    this machine find it by themselves. A liveliness token at KEY/alive ends after the last record.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! zenohsink key=uav/1
    """

    sink = "video/x-raw; application/x-tracks"
    key: str = Property(
        "streamkit", doc="Where to publish: records go to KEY/tracks, and name KEY as source."
    )
    wait_subscribers: int = Property(
        0,
        min=0,
        doc="Receivers to wait for before the first record; of 2 and more only zenohsrc is counted.",
    )
    wait_timeout_s: float = Property(30.0, min=0.0, unit="s", doc="How long to wait for them before failing.")
    max_records: int = Property(256, min=1, max=100_000, doc="Records that may wait to be sent.")
    patience_s: float = Property(
        5.0,
        min=0.0,
        max=86_400.0,
        unit="s",
        doc="How long a slow receiver may hold up the others; then it is cut off.",
    )

    _session: zenoh.Session | None = None
    _sender: RecordSender | None = None
    _declared: list[Callable[[], object]]

    def start(self) -> None:
        """Opens the session and shows that a publisher is there."""
        self._session, self._sender, self._declared = None, None, []
        self._waited = not self.wait_subscribers
        self._lost = self._number = 0
        # zenoh cuts a link off at once if told not to wait at all, for any hiccup.
        self._patience_s = max(self.patience_s, 1.0)
        self._warned = False
        try:
            records = publication_key(self.key)
        except InvalidKey as error:
            raise ResourceError(str(error)) from None
        self._session = self.open_zenoh(self._patience_s)
        self._publisher = self._session.declare_publisher(
            records,
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.BLOCK,
            reliability=zenoh.Reliability.RELIABLE,
        )
        self._declared = [self._publisher.undeclare]
        self._receivers = watch_receivers(self._session)
        self._declared.insert(0, self._receivers.close)
        # The token is left to the session's close: its end must not overtake the last records.
        self._alive = show_publisher(self._session, records)
        self._sender = RecordSender(self._publish, self.max_records, self._failed)

    def render(self, frame: Frame) -> None:
        """Lines up the frame's record."""
        assert self._sender is not None, "start() comes before frames"
        if not self._waited:
            self._wait_for_receivers()
        payload = payload_of(frame, self.key, self.clock.utc_ns(), self._lost)
        self._count_lost(self._sender.submit(payload, self.patience_s, self.stopping), "receivers too slow")

    def drain(self) -> None:
        """Sends what waits, then ends the session, by which receivers know that nothing follows."""
        if self._sender is not None:
            left = self._sender.flush(self._patience_s, self.stopping)
            if left:
                self.post_warning(f"{left} records could not be sent before the end: receivers are too slow")
            self._close(FINISH_LIMIT_S, self.stopping)

    def stop(self) -> None:
        """Ends the session within bounds."""
        self._close(STOP_LIMIT_S)

    def _wait_for_receivers(self) -> None:
        there = wait_for_receivers(
            self._publisher, self._receivers, self.wait_subscribers, self.wait_timeout_s, self.stopping
        )
        if not there and self.stopping.is_set():
            raise Flushing(self.name)
        if not there:
            raise ResourceError(
                f"wait-subscribers={self.wait_subscribers}: not there at {self._publisher.key_expr} within "
                f"{self.wait_timeout_s:g} s; start them first, or give both sides the same endpoint"
            )
        self._waited = True

    def _publish(self, payload: bytes) -> None:
        started_ns = self.clock_ns()
        # The number lets receivers tell lost records from frames that had none.
        self._publisher.put(payload, attachment=str(self._number).encode())
        self._number += 1
        if (self.clock_ns() - started_ns) / 1e9 >= self._patience_s and not self._warned:
            self._warned = True
            self.post_warning(
                f"a receiver has taken nothing for {self._patience_s:g} s and was cut off, with records lost"
            )

    def _failed(self, error: Exception) -> None:
        self._count_lost(1, "not sent")
        if not self._warned and not self.stopping.is_set():
            self._warned = True
            self.post_warning(f"a record was not sent: {plain(error)}")

    def _count_lost(self, count: int, reason: str) -> None:
        if count:
            self._lost += count
            self.count_drop(reason, count)

    def _close(self, limit_s: float, cancelled: threading.Event | None = None) -> None:
        session, sender = self._session, self._sender
        self._session, self._sender = None, None
        if sender is not None:
            self._count_lost(sender.close(), "not sent before the end")
        if session is not None and not close_session(session, limit_s, cancelled, self._declared):
            self.post_warning("a receiver takes nothing: the last records may be lost to it")
        if sender is not None:
            sender.join(STOP_LIMIT_S)
