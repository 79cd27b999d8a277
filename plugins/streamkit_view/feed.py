"""Feed: what a zenohsink publishes below one key, received and validated, as messages to pages."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import zenoh

from streamkit import TrackRecord
from streamkit_view.messages import FRAME, MOSAIC, TRACKS, VIDEO, PageMessage, binary_message, text_message
from streamkit_zenoh.keys import STATUS, publication_root, records_key, stream_key
from streamkit_zenoh.receiver import STATUS_LIMIT_BYTES, MessageReceiver, ReceivedMessage
from streamkit_zenoh.wire.encodings import RECORD_LIMIT_BYTES, BadPayload, Decoder, decode_json
from streamkit_zenoh.wire.frame_header import read_header
from streamkit_zenoh.wire.images import IMAGE_LIMIT_BYTES, PIXEL_LIMIT, image_size
from streamkit_zenoh.wire.records import TRACKS_SCHEMA
from streamkit_zenoh.wire.status import STATUS_SCHEMA, StatusRecord
from streamkit_zenoh.wire.video_header import VideoHeader

PACKET_LIMIT_BYTES = 8 << 20
QUEUE_MESSAGES, QUEUE_BYTES = 256, 64 << 20
LOOK_S = 0.5
SILENT_S = 2.0


class StreamLimits(NamedTuple):
    """Most bytes of a message, and whether the last one is asked for."""

    limit_bytes: int
    ask_last: bool


STREAMS = {
    TRACKS: StreamLimits(RECORD_LIMIT_BYTES, True),
    STATUS: StreamLimits(STATUS_LIMIT_BYTES, True),
    VIDEO: StreamLimits(PACKET_LIMIT_BYTES, False),
    FRAME: StreamLimits(IMAGE_LIMIT_BYTES, True),
    MOSAIC: StreamLimits(IMAGE_LIMIT_BYTES, True),
}


class FeedState(msgspec.Struct, frozen=True, kw_only=True):
    """State of a feed, as the page shows it.

    Attributes:
        key: where it is published, or the title.
        state: waiting, playing, silent, ended or lost.
        reason: why it does not play, a sentence; "" while it plays.
        server_ms: UTC of the server, ms.
        received: messages by stream.
        lost: messages lost on the way, by stream.
        bad: invalid messages, by stream.
        status: the publisher's last status.
        history_s: how far back a page can go, s.
    """

    key: str
    state: str
    reason: str
    server_ms: float
    received: dict[str, int]
    lost: dict[str, int]
    bad: dict[str, int]
    status: StatusRecord | None
    history_s: float = 0.0


class Feed:
    """Receives one key, each stream in a thread of its own.

    Args:
        session: an open session.
        key: of a zenohsink.
        index: of this feed.
        deliver: called with each message, from any thread.
        title: what the page shows instead of the key.

    Raises:
        InvalidKey: the key is malformed or has wildcards.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        index: int,
        deliver: Callable[[PageMessage], None],
        title: str = "",
    ) -> None:
        self.key = publication_root(key)
        self._title = title or self.key
        self._index = index
        self._deliver = deliver
        self._stopping = threading.Event()
        self._status: StatusRecord | None = None
        self._last_record_s = 0.0
        self._records = Decoder(TrackRecord, TRACKS_SCHEMA)
        self._statuses = Decoder(StatusRecord, STATUS_SCHEMA)
        self._receivers = {
            name: MessageReceiver(
                session,
                records_key(self.key) if name == TRACKS else stream_key(self.key, name),
                capacity=QUEUE_MESSAGES,
                max_bytes=QUEUE_BYTES,
                newest=True,
                limit_bytes=limits.limit_bytes,
                ask_last=limits.ask_last,
                ends_with_publisher=False,
            )
            for name, limits in STREAMS.items()
        }
        self._threads = [
            threading.Thread(target=self._receive, args=(name,), name=f"view {name}") for name in STREAMS
        ]
        for thread in self._threads:
            thread.start()

    def state(self, failure: str = "", waiting: str = "") -> FeedState:
        """The state now; why the pipeline of this feed failed, and what is waited for, if known."""
        counts = {name: receiver.counts() for name, receiver in self._receivers.items()}
        tracks, status = self._receivers[TRACKS], self._status
        state, reason = "playing", ""
        if not counts[TRACKS].publishers:
            has_begun = any(count.received for count in counts.values())
            state, reason = "waiting", waiting or f"No publisher at {self.key} yet."
            if failure:
                state, reason = "lost", failure
            elif tracks.has_vanished:
                state, reason = (
                    "lost",
                    "The publisher is gone without an end: killed, or its link is cut.",
                )
            elif has_begun:
                state, reason = "ended", "The stream has ended."
        elif self._last_record_s and time.monotonic() - self._last_record_s > SILENT_S:
            silent_s = time.monotonic() - self._last_record_s
            state = "silent"
            reason = f"No frame for {silent_s:.0f} s: the feed is lost, or the pipeline stands still."
        elif not self._last_record_s:
            state, reason = "waiting", waiting or "The publisher is there; no frame has come yet."
        return FeedState(
            key=self._title,
            state=state,
            reason=reason,
            server_ms=time.time_ns() / 1e6,
            received={name: count.received for name, count in counts.items()},
            lost={name: count.lost + count.overwritten for name, count in counts.items()},
            bad={name: count.bad for name, count in counts.items() if count.bad},
            status=status,
        )

    def close(self) -> list[Callable[[], object]]:
        """Ends the threads; returns the calls that undeclare everything."""
        self._stopping.set()
        for receiver in self._receivers.values():
            receiver.queue.close()
        for thread in self._threads:
            thread.join(2 * LOOK_S)
        return [call for receiver in self._receivers.values() for call in receiver.undeclare]

    def _receive(self, name: str) -> None:
        receiver = self._receivers[name]
        convert = {TRACKS: self._record, STATUS: self._note_status, VIDEO: self._packet}.get(name)
        while not self._stopping.is_set():
            received = receiver.queue.get(LOOK_S)
            if received is None or received.is_deleted:
                continue
            try:
                message = convert(received) if convert else self._image(name, received)
            except (ValueError, BadPayload):
                receiver.count_bad()
                continue
            if message is not None:
                self._deliver(message)

    def _record(self, received: ReceivedMessage) -> PageMessage:
        record = self._records.decode(received.content_type, received.payload)
        self._last_record_s = time.monotonic()
        return text_message(TRACKS, self._index, msgspec.json.encode(record))

    def _note_status(self, received: ReceivedMessage) -> None:
        self._status = self._statuses.decode(received.content_type, received.payload)

    def _packet(self, received: ReceivedMessage) -> PageMessage:
        header = decode_json(received.header, VideoHeader)
        extra: dict[str, object] = {"run": str(received.stamp.run), "number": received.stamp.number}
        return binary_message(
            VIDEO,
            self._index,
            msgspec.json.encode(header),
            received.payload,
            extra,
            is_keyframe=header.keyframe,
        )

    def _image(self, name: str, received: ReceivedMessage) -> PageMessage:
        header, size = read_header(received.header), image_size(received.payload)
        if size is None or not 0 < size[0] * size[1] <= PIXEL_LIMIT:
            raise ValueError(f"not an image of 1 to {PIXEL_LIMIT} pixels")
        extra: dict[str, object] = {"png": received.payload[:1] == b"\x89"}
        return binary_message(name, self._index, msgspec.json.encode(header), received.payload, extra)
