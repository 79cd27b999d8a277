"""Feed: what a zenohsink publishes below one key, received and validated, as messages to pages."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Callable

import msgspec
import zenoh

from streamkit import TRACKS_SCHEMA, TrackRecord
from streamkit_view.messages import FRAME, MOSAIC, TRACKS, VIDEO, PageMessage, binary_message
from streamkit_view.mosaic_tiles import MosaicTiles
from streamkit_view.playback import PrintedLine
from streamkit_zenoh.keys import STATUS, publication_root, stream_key
from streamkit_zenoh.receiver import STATUS_LIMIT_BYTES, Counts, MessageReceiver, ReceivedMessage
from streamkit_zenoh.wire.encodings import RECORD_LIMIT_BYTES, decode_json, decode_message
from streamkit_zenoh.wire.frame_header import read_header
from streamkit_zenoh.wire.images import IMAGE_LIMIT_BYTES, PIXEL_LIMIT, image_size
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, StatusRecord
from streamkit_zenoh.wire.video_header import VideoHeader

PACKET_LIMIT_BYTES = 8 << 20
QUEUE_MESSAGES, QUEUE_BYTES = 256, 64 << 20
POLL_S = 0.5
SILENT_S = 2.0
NOTHING_PRINTED = PrintedLine()


# Most bytes of a message, by stream; records are last, since a publisher waits for the receiver of these.
LIMIT_BYTES = {
    VIDEO: PACKET_LIMIT_BYTES,
    FRAME: IMAGE_LIMIT_BYTES,
    MOSAIC: IMAGE_LIMIT_BYTES,
    STATUS: STATUS_LIMIT_BYTES,
    TRACKS: RECORD_LIMIT_BYTES,
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
    history_s: float


class Feed:
    """Receives one key, each stream in a thread of its own.

    Args:
        session: an open session.
        key: of a zenohsink.
        index: of this feed.
        deliver: called with each message, from any thread.
        title: what the page shows instead of the key, or "".

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
        self._counted: object = None  # frames in the last status, of which run
        self._last_frame_s = 0.0
        self._mosaic = MosaicTiles(index)
        self._receivers = {
            name: MessageReceiver(
                session,
                stream_key(self.key, name),
                capacity=QUEUE_MESSAGES,
                max_bytes=QUEUE_BYTES,
                newest=True,
                limit_bytes=limit_bytes,
                ask_last=name != VIDEO,
                ends_with_publisher=False,
            )
            for name, limit_bytes in LIMIT_BYTES.items()
        }
        self._threads = [
            threading.Thread(target=self._receive, args=(name,), name=f"view {name}") for name in LIMIT_BYTES
        ]
        for thread in self._threads:
            thread.start()

    def state(
        self, history_s: float, failure: str = "", waiting: str = "", printed: PrintedLine = NOTHING_PRINTED
    ) -> FeedState:
        """The state now.

        Args:
            history_s: how far back a page can go, s.
            failure: why the pipeline of this feed failed, if it did.
            waiting: what is waited for, if known.
            printed: what its pipeline printed last, if known; since the last frame, it is why no other comes.
        """
        counts = {name: receiver.counts() for name, receiver in self._receivers.items()}
        state, reason = self._activity(counts, failure, waiting, printed)
        return FeedState(
            key=self._title,
            state=state,
            reason=reason,
            server_ms=time.time_ns() / 1e6,
            received={name: count.received for name, count in counts.items()},
            lost={name: count.lost + count.overwritten for name, count in counts.items()},
            bad={name: count.bad for name, count in counts.items() if count.bad},
            status=self._status,
            history_s=round(history_s, 1),
        )

    def _activity(
        self, counts: dict[str, Counts], failure: str, waiting: str, printed: PrintedLine
    ) -> tuple[str, str]:
        """The word for the state, and the reason."""
        silent_s = time.monotonic() - self._last_frame_s
        if not counts[TRACKS].publishers:
            if failure:
                return "lost", failure
            if self._receivers[TRACKS].has_vanished:
                return "lost", "The publisher is gone without an end: killed, or its link is cut."
            if any(count.received for count in counts.values()):
                return "ended", "The stream has ended."
            return "waiting", waiting or f"No publisher at {self.key} yet."
        is_starting = self._status is not None and self._status.state == "starting"
        if is_starting or not self._last_frame_s:
            return "waiting", waiting or "The publisher is there; no frame has come yet."
        if silent_s > SILENT_S:
            is_reason = printed.at_s > self._last_frame_s - SILENT_S  # a frame may still be under way
            why = printed.text if is_reason else "the feed is lost, or the pipeline stands still."
            return "silent", f"No frame for {silent_s:.0f} s: {why}"
        return "playing", ""

    def close(self) -> list[Callable[[], object]]:
        """Ends the threads; returns the calls that undeclare everything."""
        self._stopping.set()
        for receiver in self._receivers.values():
            receiver.queue.close()
        for thread in self._threads:
            thread.join(2 * POLL_S)
        return [call for receiver in self._receivers.values() for call in receiver.undeclare]

    def _receive(self, name: str) -> None:
        receiver = self._receivers[name]
        while not self._stopping.is_set():
            received = receiver.queue.get(POLL_S)
            if received is None or received.is_deleted:
                continue
            try:
                messages = self._messages(name, received)
            except ValueError:
                receiver.count_bad()
                continue
            for message in messages:
                self._deliver(message)

    def _messages(self, name: str, received: ReceivedMessage) -> list[PageMessage]:
        """The messages to pages; raises ValueError if what was received is invalid."""
        payload, feed = received.payload, self._index
        if name == STATUS:
            self._note_status(decode_message(StatusRecord, STATUS_SCHEMA, received.content_type, payload))
            return []
        if name == TRACKS:
            record = decode_message(TrackRecord, TRACKS_SCHEMA, received.content_type, payload)
            if not received.is_reply:
                self._last_frame_s = time.monotonic()
            text = zlib.compress(msgspec.json.encode(record), 1)  # long: a payload in place of the body
            return [binary_message(TRACKS, feed, b"null", text)]
        if name == VIDEO:
            packet = decode_json(received.header, VideoHeader)
            run, number = received.stamp
            body = msgspec.json.encode({"packet": packet, "run": str(run), "number": number})
            return [binary_message(VIDEO, feed, body, payload, is_keyframe=packet.keyframe)]
        header = read_header(received.header)
        if name == MOSAIC:
            return self._mosaic.update(payload, header, received.stamp.run)
        size = image_size(payload)
        if size is None or not 0 < size[0] * size[1] <= PIXEL_LIMIT:
            raise ValueError(f"not an image of 1 to {PIXEL_LIMIT} pixels")
        return [binary_message(FRAME, feed, msgspec.json.encode(header), payload)]

    def _note_status(self, status: StatusRecord) -> None:
        """A publisher without records, `tracks=false`, is seen to play as its count of frames grows."""
        counted = status.run, status.frames
        if status.frames and self._counted not in (None, counted):
            self._last_frame_s = time.monotonic()
        self._status, self._counted = status, counted
