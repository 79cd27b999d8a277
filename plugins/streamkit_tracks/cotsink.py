"""cotsink: targets with ground coordinates as Cursor-on-Target events, for TAK."""

from typing import Any

import msgspec
from typing_extensions import override

from streamkit import Frame, Property, RecordTally, ResourceError, Sink, track_record
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_tracks.cursor_on_target import EventSender, InvalidAddress, events
from streamkit_tracks.file_formats import located

STOP_LIMIT_S = 2.0


class CotSink(Sink):
    """Sends each shown target (confirmed or coasting) with ground coordinates as a Cursor-on-Target event.

    Over UDP, including multicast, or TCP, from a thread of its own: events that do not fit the queue are
    dropped and counted, a lost TCP connection is opened again. Coordinates come with the records, or from
    pose and ground-altitude.

    Example:
        zenohsrc key=uav/1 timeout-s=10 ! cotsink address=udp://239.2.3.1:6969
    """

    sink = "video/x-raw; application/x-tracks"
    address: str = Property("udp://239.2.3.1:6969", doc="Destination: udp://HOST:PORT or tcp://HOST:PORT.")
    source: str = Property("streamkit", doc="Source named in the events of frames that are no records.")
    cot_type: str = Property("a-u-G", doc="Type of the events in the CoT hierarchy.")
    stale_s: float = Property(5.0, min=0.1, unit="s", doc="How long an event is valid.")
    interval_s: float = Property(1.0, min=0.0, unit="s", doc="Shortest time between two events of a target.")
    ground_altitude: float | None = Property(
        None, unit="m", doc="Altitude of the ground with the datum of the poses; by default as reported."
    )
    max_queue: int = Property(64, min=1, doc="Records that may wait to be sent.")

    _executor: BackgroundExecutor | None = None
    _sender: EventSender | None = None

    @override
    def start(self) -> None:
        self._executor = self._sender = None
        self._waits: dict[int, int] = {}  # by id, until when no other event of a target is due, ns
        self._tally = RecordTally(needs_positions=True)
        try:
            self._sender = EventSender(self.address)
        except InvalidAddress as error:
            raise ResourceError(str(error)) from None
        except OSError as error:
            raise ResourceError(
                f"address={self.address}: {error}; start the server or name another"
            ) from error
        self._executor = BackgroundExecutor(f"{self.name} sender", self._failed, capacity=self.max_queue)

    @override
    def render(self, frame: Frame) -> None:
        sender = self._sender
        assert self._executor is not None, "start() precedes frames"
        assert sender is not None, "start() precedes frames"
        record = track_record(
            frame,
            source=self.source,
            published_ns=self.clock.utc_ns(),
            ground_altitude_m=self.ground_altitude,
        )
        self._tally.note(frame, record, self.ground_altitude)
        found = list(events(self._due(msgspec.to_builtins(record)), self.cot_type, self.stale_s))
        if not found:
            return
        dropped = self._executor.submit_dropping(lambda: sender.send(found))
        if dropped:
            self.count_drop("queue full", dropped)

    def _due(self, record: dict[str, Any]) -> dict[str, Any]:
        """The record with those of its targets of which an event is due."""
        now_ns = self.clock_ns()
        self._waits = {number: until for number, until in self._waits.items() if until > now_ns}
        due = [track for track in located(record) if track["id"] not in self._waits]
        next_ns = now_ns + round(self.interval_s * 1e9)
        self._waits.update((track["id"], next_ns) for track in due)
        return {**record, "tracks": due}

    @override
    def drain(self) -> None:
        if self._executor is not None:
            left = self._executor.wait_idle(STOP_LIMIT_S, self.stopping)
            if left:
                self.count_drop("not sent before the end", left)

    @override
    def stop(self) -> None:
        executor, sender = self._executor, self._sender
        self._executor = self._sender = None
        if sender is not None and (text := self._tally.shortfall()):
            self.post_warning(f"{self.address}: {text}", "shortfall")
        if executor is not None:
            executor.close(STOP_LIMIT_S)
        if sender is not None:
            sender.close()

    def _failed(self, error: Exception) -> None:
        self.count_drop("not sent")
        if not self.stopping.is_set():
            self.warn_once(f"events to {self.address} are not sent: {error}; retrying", "failure")
