"""zenohsrc: track records from zenoh, as frames."""

import threading
from collections.abc import Callable, Iterator, Sequence

import zenoh

from streamkit import Caps, Frame, Property, ResourceError, Source, StreamError
from streamkit_zenoh.connection import Connection
from streamkit_zenoh.keys import InvalidKey, alive_key, records_key
from streamkit_zenoh.mailbox import Mailbox
from streamkit_zenoh.numbering import Numbering
from streamkit_zenoh.presence import Watch, show_receiver
from streamkit_zenoh.records import TRACKS_CAPS, TRACKS_NAME, frame_of
from streamkit_zenoh.session import close_session

LOOK_EVERY_S = 0.2
STOP_LIMIT_S = 3.0
# A record of ten thousand tracks has 3 MB; more is no record.
RECORD_LIMIT_BYTES = 4 * 1024 * 1024
HELD_LIMIT_BYTES = 64 * 1024 * 1024


class ZenohSrc(Connection, Source):
    """Receives the records that zenohsink publishes: bytes as data, Tracks and Registration as metadata.

    Ends when the last publisher has gone, behind its last record; with eos-on-disconnect=false it waits for
    the next one, whose records come in a new epoch. Data that is no record is counted and skipped.

    Example:
        zenohsrc key=uav/1 num-buffers=100 timeout-s=10 ! tracksink location=received.jsonl
    """

    is_live = True
    src = TRACKS_NAME
    key: str = Property("streamkit", doc="What zenohsink has as key; may have wildcards, uav/*.")
    num_buffers: int = Property(-1, min=-1, doc="Records to pass on before EOS; -1 is no limit.")
    timeout_s: float = Property(
        0.0, min=0.0, unit="s", doc="Fail after so long without a record; 0 never does."
    )
    eos_on_disconnect: bool = Property(True, doc="End when the last publisher has gone.")
    newest: bool = Property(
        False, doc="Drop the oldest records when downstream is slow, instead of holding up the publisher."
    )
    max_records: int = Property(1024, min=1, max=100_000, doc="Records held for downstream.")

    _session: zenoh.Session | None = None
    _declared: Sequence[Callable[[], object]] = ()

    def start(self) -> None:
        """Opens the session and listens; records are held until frames are asked for."""
        self._session, self._declared = None, []
        self._interrupted = threading.Event()
        self._epoch_base = self._last_epoch = 0
        self._numbering = Numbering()
        self._box: Mailbox[tuple[str, bytes, bytes]] = Mailbox(
            self.max_records, HELD_LIMIT_BYTES, self.newest
        )
        try:
            records = records_key(self.key)
        except InvalidKey as error:
            raise ResourceError(str(error)) from None
        self._session = self.open_zenoh()
        # Called in zenoh's own thread: what waits in the box is all that waits.
        handler = zenoh.handlers.Callback(self._received, indirect=False)
        subscriber = self._session.declare_subscriber(records, handler)
        publishers = Watch(self._session, alive_key(records), self._publishers_changed)
        shown = show_receiver(self._session, records)
        self._declared = [shown.undeclare, publishers.close, subscriber.undeclare]

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps of records; their frame size is told by the first one."""
        return TRACKS_CAPS

    def frames(self) -> Iterator[Frame]:
        """Records in order, as frames."""
        passed, counted, heard_ns = 0, 0, self.clock_ns()
        while passed != self.num_buffers and not self._interrupted.is_set():
            item = self._box.take(LOOK_EVERY_S)
            if self._box.dropped > counted:
                self.count_drop("downstream too slow", self._box.dropped - counted)
                counted = self._box.dropped
            frame = None if item is None else self._frame(*item)
            if frame is not None:
                heard_ns = self.clock_ns()
                passed += 1
                yield frame
            elif item is None and self._box.is_over:
                return
            elif self.timeout_s and (self.clock_ns() - heard_ns) / 1e9 > self.timeout_s:
                raise ResourceError(
                    f"no record at {records_key(self.key)} for {self.timeout_s:g} s; "
                    "start the publisher, with the same key and an endpoint that meets this one"
                )

    def interrupt(self) -> None:
        """Ends the stream; what is still held is not passed on."""
        self._interrupted.set()
        self._box.close()

    def stop(self) -> None:
        """Ends the session within bounds."""
        session, self._session = self._session, None
        if session is not None:
            self._box.close()
            if not close_session(session, STOP_LIMIT_S, undeclare=self._declared):
                self.post_warning("zenoh has not closed in time; it ends in the background")

    def _received(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        size = len(sample.payload)
        payload = sample.payload.to_bytes() if size <= RECORD_LIMIT_BYTES else b""
        number = b"" if sample.attachment is None else sample.attachment.to_bytes()[:32]
        self._box.put((str(sample.key_expr), payload, number), len(payload))

    def _publishers_changed(self, count: int) -> None:
        if self.eos_on_disconnect:
            self._box.end(count == 0)

    def _frame(self, key: str, payload: bytes, number: bytes) -> Frame | None:
        restarts = self._numbering.restarts
        lost = self._numbering.lost_before(key, number)
        if lost:
            self.count_drop("lost on the way", lost)
        if self._numbering.restarts > restarts:
            self._epoch_base = self._last_epoch + 1
        try:
            frame = frame_of(payload, self.clock_ns(), self._epoch_base)
        except StreamError as error:
            if not self.drops["not a record"]:
                self.post_warning(f"data at {key} is skipped: {error}")
            self.count_drop("not a record")
            return None
        self._last_epoch = frame.epoch
        return frame
