"""Receives the messages of one key expression: bounded, numbered, and counted whatever becomes of them."""

import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import zenoh

from streamkit_zenoh.keys import RECEIVER, STATUS, alive_key, receiver_name, root_of
from streamkit_zenoh.presence import Watch, confirm_receiver, show_receiver
from streamkit_zenoh.receive.mailbox import Mailbox
from streamkit_zenoh.wire.forms import BadPayload, Codec, form_of
from streamkit_zenoh.wire.numbering import ATTACHMENT_LIMIT_BYTES, Numbering, read_attachment, remember
from streamkit_zenoh.wire.status import STATUS_SCHEMA, StatusRecord

LAST_LIMIT_S = 5.0
STATUS_LIMIT_BYTES = 64 * 1024


class Received(NamedTuple):
    """One message.

    Attributes:
        key: where it was published.
        payload: its bytes.
        encoding: as zenoh writes it, `application/json;streamkit.tracks/1`.
        header: what stood behind the stamp in its attachment.
        run: which run of its publisher it is from; 0 where it does not say.
        is_deleted: it says that what was at the key has ended.
    """

    key: str
    payload: bytes
    encoding: str
    header: bytes
    run: int
    is_deleted: bool


class Counts(msgspec.Struct, frozen=True):
    """What became of messages.

    Attributes:
        received: arrived, each counted once, whatever became of them then.
        lost: missed on the way: gaps in the publishers' numbers.
        overwritten: dropped here, as newer ones came before they were taken.
        repeated: arrived once more; passed on once.
        bad: larger than allowed, or not what they should be; skipped.
        restarts: how often a publisher took over from another.
        jumps: steps of more than ten million numbers, which count as no losses: see `wire.sequence`.
        publishers: alive now.
    """

    received: int
    lost: int
    overwritten: int
    repeated: int
    bad: int
    restarts: int
    jumps: int
    publishers: int


class Reception:
    """Receives in zenoh's thread, into a box that one thread takes from.

    Args:
        session: an open session.
        expression: which keys; wildcards and several publishers are fine.
        box: what waits in it is all that waits.
        limit_bytes: messages larger than this are bad.
        ask_last: whether the last message of each publisher is asked for, so that there is state at once.
        publishers_changed: called with the number of publishers that live, from zenoh's thread.
    """

    def __init__(
        self,
        session: zenoh.Session,
        expression: str,
        box: Mailbox[Received],
        limit_bytes: int,
        ask_last: bool = True,
        publishers_changed: Callable[[int], None] = lambda count: None,
    ) -> None:
        self.box = box
        self._session = session
        self._expression = expression
        self._limit_bytes = limit_bytes
        self._ask_last = ask_last
        self._publishers_changed = publishers_changed
        self._numbering = Numbering()
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._publishers = 0
        self._running: OrderedDict[str, tuple[int, bool]] = OrderedDict()
        self._codecs: dict[str, Codec[StatusRecord]] = {}
        self._settled: OrderedDict[tuple[str, int], int] = OrderedDict()
        # Called in zenoh's own thread: what waits in the box is all that waits.
        direct = zenoh.handlers.Callback
        self._status_key = f"{root_of(expression)}/{STATUS}"
        name = receiver_name(str(session.info.zid()), expression)
        self._status_question = f"{self._status_key}?{RECEIVER}={name}"
        # First: a publisher that sees a receiver of its records must know that its end is listened to.
        status = session.declare_subscriber(self._status_key, direct(self._status_arrived, indirect=False))
        confirms = confirm_receiver(session, expression)
        subscriber = session.declare_subscriber(expression, direct(self._arrived, indirect=False))
        # At once behind the subscription: from here on publishers count what they send this receiver.
        shown = show_receiver(session, expression)
        alive = Watch(session, alive_key(expression), self._alive_changed)
        self.declared: list[Callable[[], object]] = [
            shown.undeclare,
            confirms.undeclare,
            alive.close,
            status.undeclare,
            subscriber.undeclare,
        ]

    def counts(self) -> Counts:
        """What became of the messages so far."""
        with self._lock:
            found = self._counts
            return Counts(
                received=found["received"],
                lost=found["lost"],
                overwritten=self.box.dropped,
                repeated=found["repeated"],
                bad=found["bad"],
                restarts=found["restarts"],
                jumps=found["jumps"],
                publishers=self._publishers,
            )

    @property
    def has_vanished(self) -> bool:
        """Whether nobody publishes any more, and one that told how it is has not told that it ends."""
        with self._lock:
            return not self._publishers and any(runs for _, runs in self._running.values())

    def count_bad(self) -> None:
        """Counts a message that turned out not to be what it should be."""
        with self._lock:
            self._counts["bad"] += 1

    def _arrived(self, sample: zenoh.Sample, live: bool = True) -> None:
        attachment = sample.attachment
        raw = b"" if attachment is None or len(attachment) > ATTACHMENT_LIMIT_BYTES else attachment.to_bytes()
        stamp, header = read_attachment(raw)
        key, size = str(sample.key_expr), len(sample.payload)
        with self._lock:
            arrival = (self._numbering.arrived if live else self._numbering.answered)(key, stamp)
            self._counts["received"] += arrival.is_new
            self._counts["lost"] += arrival.lost
            self._counts["restarts"] += arrival.is_restart
            self._counts["jumps"] += arrival.is_jump
            self._counts["repeated"] += live and not arrival.is_new
            self._counts["bad"] += arrival.is_new and size > self._limit_bytes
        if not arrival.is_new or size > self._limit_bytes:
            return
        run = 0 if stamp is None else stamp.run
        deleted = sample.kind == zenoh.SampleKind.DELETE
        item = Received(key, sample.payload.to_bytes(), str(sample.encoding), header, run, deleted)
        self.box.put(item, size + len(header))

    def _answered(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._arrived(reply.ok, live=False)

    def _alive_changed(self, count: int) -> None:
        with self._lock:
            appeared = count > self._publishers
            self._publishers = count
        if appeared:
            # The status first: it tells which records come by themselves.
            handler = zenoh.handlers.Callback(self._status_answered, indirect=False)
            self._session.get(self._status_question, handler, timeout=LAST_LIMIT_S)
        if appeared and self._ask_last:
            handler = zenoh.handlers.Callback(self._answered, indirect=False)
            # Behind all that comes by itself, whatever its priority.
            self._session.get(
                self._expression,
                handler,
                timeout=LAST_LIMIT_S,
                priority=zenoh.Priority.BACKGROUND,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        self._publishers_changed(count)

    def _status_answered(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._status_arrived(reply.ok, is_answer=True)

    def _status_arrived(self, sample: zenoh.Sample, is_answer: bool = False) -> None:
        """A publisher says how far it is: what was lost at the end shows without a record behind it."""
        if sample.kind == zenoh.SampleKind.DELETE or len(sample.payload) > STATUS_LIMIT_BYTES:
            return
        status = self._read_status(sample)
        if status is None:
            return
        name = self._expression.rsplit("/", 1)[-1]
        key = f"{str(sample.key_expr).removesuffix(STATUS)}{name}"
        with self._lock:
            self._note_state(status)
            for stream in status.streams:
                if stream.name == name and is_answer:
                    untold = max(stream.next_number, stream.settled_number)
                    begins = untold if stream.first_number is None else stream.first_number
                    self._counts["lost"] += self._numbering.begins(key, stream.run, begins)
                if stream.name == name:
                    # A status may overtake records: what it says counts when the next one comes.
                    said = self._settled.get((key, stream.run), 0)
                    settled = stream.settled_number if status.state == "ended" else said
                    self._counts["lost"] += self._numbering.catch_up(key, stream.run, settled)
                    remember(self._settled, (key, stream.run), stream.settled_number)

    def _note_state(self, status: StatusRecord) -> None:
        """An answer from before the end may come behind it, and one of an earlier run behind the next."""
        run, runs = self._running.get(status.source, (status.run, True))
        if status.run > run or (status.run == run and runs):
            remember(self._running, status.source, (status.run, status.state != "ended"))

    def _read_status(self, sample: zenoh.Sample) -> StatusRecord | None:
        form = form_of(str(sample.encoding))
        if form is None:
            return None
        try:
            codec = self._codecs.get(form)
            if codec is None:
                codec = self._codecs[form] = Codec(StatusRecord, STATUS_SCHEMA, form)
            return codec.decode(sample.payload.to_bytes())
        except (BadPayload, ImportError):
            return None
