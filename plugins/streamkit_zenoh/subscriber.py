"""TrackSubscriber: track records from zenoh for a Python program, without a pipeline."""

import threading
import time
from collections.abc import Iterator
from typing import NamedTuple, Self

from streamkit import TRACKS_SCHEMA, TrackRecord
from streamkit_zenoh.configuration import Reach, SessionMode, SessionSettings
from streamkit_zenoh.keys import records_key
from streamkit_zenoh.presence import published_keys
from streamkit_zenoh.receiver import Counts, MessageReceiver
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.encodings import RECORD_LIMIT_BYTES, BadPayload, decode_message

POLL_S = 0.2
CLOSE_LIMIT_S = 2.0
LOOK_LIMIT_S = 1.0
QUEUE_LIMIT_BYTES = 64 * 1024 * 1024


class Update(NamedTuple):
    """News of a key: a record, or None when the key was deleted; the run of its publisher."""

    key: str
    record: TrackRecord | None
    run: int = 0


class TrackSubscriber:
    """Receives track records; iterate over it.

        with TrackSubscriber("uav/1", connect="tcp/192.168.0.7:7447") as subscriber:
            for record in subscriber:
                print(record.seq, [track.id for track in record.tracks])

    By default it holds one record, the newest, so that a slow reader sees the present. Lost, overwritten and
    invalid messages are in `counts`. The last record of each publisher is received at once.

    Args:
        key: the key of zenohsink, possibly with wildcards. `uav/1/track/*` gives each target by itself.
        connect: endpoints to connect to, with commas; without it and `listen`, publishers on this machine.
        listen: endpoints to listen on, with commas.
        mode: auto, peer or client.
        reach: which publishers are found without endpoints: local is this machine, network the local network.
        config: a zenoh configuration file, for TLS, passwords and everything else.
        ring: most records held; the oldest is dropped for a new one.
        lossless: blocks the publisher instead of dropping, and with it everything else it sends here.
        ask_last: whether to query the last record of each publisher.
        ends_with_publisher: whether iteration ends when the last publisher is gone.

    Raises:
        InvalidKey: the key is malformed.
        InvalidEndpoint: an endpoint is malformed.
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
        self._closing = threading.Lock()
        expression = records_key(key)
        self._session = open_session(
            SessionSettings(connect, listen, SessionMode(mode), Reach(reach), config)
        )
        self._receiver = MessageReceiver(
            self._session,
            expression,
            capacity=ring,
            max_bytes=QUEUE_LIMIT_BYTES,
            newest=not lossless,
            limit_bytes=RECORD_LIMIT_BYTES,
            ask_last=ask_last,
            ends_with_publisher=ends_with_publisher,
        )
        self._queue = self._receiver.queue

    @property
    def counts(self) -> Counts:
        """What became of the messages so far."""
        return self._receiver.counts()

    def warnings(self) -> list[str]:
        """What a user must know about the numbers of the messages so far."""
        return self._receiver.warnings()

    def published_keys(self, limit_s: float = LOOK_LIMIT_S) -> list[str]:
        """The keys of all publishers in reach, as far as they reply within the limit."""
        return published_keys(self._session, limit_s)

    @property
    def is_over(self) -> bool:
        """Whether no record is held and none follows."""
        return self._queue.is_over

    @property
    def has_vanished(self) -> bool:
        """Whether all publishers are gone and at least one never reported `ended`: killed, or cut off."""
        return self._receiver.has_vanished

    def __iter__(self) -> Iterator[TrackRecord]:
        """Records as they are received, until `close`, or the end that `ends_with_publisher` gives."""
        return (update.record for update in self.updates() if update.record is not None)

    def updates(self) -> Iterator[Update]:
        """Records with their keys, and deletions of keys, as they are received."""
        while not self._queue.is_over:
            update = self.update(POLL_S)
            if update is not None:
                yield update

    def get(self, timeout_s: float) -> TrackRecord | None:
        """The next record; None when none is received within the time limit."""
        deadline_s = time.monotonic() + timeout_s
        while (update := self.update(max(0.0, deadline_s - time.monotonic()))) is not None:
            if update.record is not None:
                return update.record
        return None

    def update(self, timeout_s: float) -> Update | None:
        """The next record or deletion; None when none is received within the time limit."""
        deadline_s = time.monotonic() + timeout_s
        while (message := self._queue.get(max(0.0, deadline_s - time.monotonic()))) is not None:
            if message.is_deleted:
                return Update(message.key, None, message.stamp.run)
            try:
                record = decode_message(TrackRecord, TRACKS_SCHEMA, message.content_type, message.payload)
                return Update(message.key, record, message.stamp.run)
            except BadPayload:
                self._receiver.count_bad()
        return None

    def close(self) -> bool:
        """Ends iteration and the session; whether zenoh closed within the time limit."""
        self._queue.close()
        with self._closing:
            undeclare, self._receiver.undeclare = self._receiver.undeclare, []
            return close_session(self._session, CLOSE_LIMIT_S, undeclare=undeclare) if undeclare else True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
