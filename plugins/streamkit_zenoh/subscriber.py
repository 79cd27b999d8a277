"""TrackSubscriber: track records from zenoh for a program of one's own, without a pipeline."""

import threading
import time
from collections.abc import Iterator
from types import TracebackType
from typing import NamedTuple, Self

from streamkit import TrackRecord
from streamkit_zenoh.endpoints import endpoints
from streamkit_zenoh.keys import records_key
from streamkit_zenoh.receive.decoding import RecordDecoder
from streamkit_zenoh.receive.mailbox import Mailbox
from streamkit_zenoh.receive.reception import Counts, Received, Reception
from streamkit_zenoh.session import Mode, Reach, SessionSettings, close_session, open_session
from streamkit_zenoh.wire.forms import RECORD_LIMIT_BYTES, BadPayload

LOOK_EVERY_S = 0.2
CLOSE_LIMIT_S = 2.0
HELD_LIMIT_BYTES = 64 * 1024 * 1024


class Update(NamedTuple):
    """What is new at a key: a record, or None where what was there has ended."""

    key: str
    record: TrackRecord | None


class TrackSubscriber:
    """Receives track records; iterate over it.

        with TrackSubscriber("uav/1", connect="tcp/192.168.0.7:7447") as subscriber:
            for record in subscriber:
                print(record.seq, [track.id for track in record.tracks])

    By default it holds one record, the newest: whoever is slow sees the present and not the past. What is
    missed, overwritten or not a record is in `counts`. The last record of each publisher comes at once.

    Args:
        key: what zenohsink has as key; wildcards are fine. `uav/1/track/*` gives each target by itself.
        connect: endpoints to connect to, with commas; without it and `listen`, publishers on this machine.
        listen: endpoints to listen on, with commas.
        mode: auto, peer or client.
        reach: who is found without endpoints: local is this machine, network the local network.
        config: a zenoh configuration file, for TLS, passwords and all else.
        ring: most records held; the oldest is dropped for a new one.
        lossless: holds the publisher up instead of dropping, and with it everything else it sends here.
        ask_last: whether the last record of each publisher is asked for.
        ends_with_publisher: whether iteration ends when the last publisher has gone.

    Raises:
        InvalidKey: the key is none.
        InvalidEndpoint: an endpoint is none.
        SessionFailure: the session cannot be opened.
    """

    def __init__(
        self,
        key: str,
        *,
        connect: str | None = None,
        listen: str | None = None,
        mode: str = "auto",
        reach: str = "local",
        config: str | None = None,
        ring: int = 1,
        lossless: bool = False,
        ask_last: bool = True,
        ends_with_publisher: bool = False,
    ) -> None:
        self._decoder = RecordDecoder()
        self._box: Mailbox[Received] = Mailbox(ring, HELD_LIMIT_BYTES, newest=not lossless)
        self._ends = ends_with_publisher
        self._closing = threading.Lock()
        expression = records_key(key)
        settings = SessionSettings(Mode(mode), endpoints(connect), endpoints(listen), Reach(reach), config)
        self._session = open_session(settings)
        self._reception = Reception(
            self._session, expression, self._box, RECORD_LIMIT_BYTES, ask_last, self._publishers_changed
        )

    @property
    def counts(self) -> Counts:
        """What became of the messages so far."""
        return self._reception.counts()

    @property
    def is_over(self) -> bool:
        """Whether nothing is held and nothing follows."""
        return self._box.is_over

    @property
    def has_vanished(self) -> bool:
        """Whether the last publisher has gone without an end of its stream: killed, or the way to it cut."""
        return self._reception.has_vanished

    def __iter__(self) -> Iterator[TrackRecord]:
        """Records as they come, until `close` is called or the last publisher has gone."""
        return (update.record for update in self.updates() if update.record is not None)

    def updates(self) -> Iterator[Update]:
        """Records with their keys, and the ends of targets, as they come."""
        while not self._box.is_over:
            update = self.update(LOOK_EVERY_S)
            if update is not None:
                yield update

    def get(self, timeout_s: float) -> TrackRecord | None:
        """The next record, or None when none has come within the limit."""
        deadline_s = time.monotonic() + timeout_s
        while (update := self.update(max(0.0, deadline_s - time.monotonic()))) is not None:
            if update.record is not None:
                return update.record
        return None

    def update(self, timeout_s: float) -> Update | None:
        """The next record or end, or None when none has come within the limit; bad data is skipped."""
        deadline_s = time.monotonic() + timeout_s
        while (message := self._box.take(max(0.0, deadline_s - time.monotonic()))) is not None:
            if message.is_deleted:
                return Update(message.key, None)
            try:
                return Update(message.key, self._decoder.decode(message))
            except BadPayload:
                self._reception.count_bad()
        return None

    def close(self) -> bool:
        """Ends iteration and the session; whether zenoh closed within bounds."""
        self._box.close()
        with self._closing:
            declared, self._reception.declared = self._reception.declared, []
            return close_session(self._session, CLOSE_LIMIT_S, undeclare=declared) if declared else True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _publishers_changed(self, count: int) -> None:
        if self._ends:
            self._box.end(count == 0)
