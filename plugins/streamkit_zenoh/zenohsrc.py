"""zenohsrc: track records or images from zenoh, as frames with their metadata."""

import enum
import threading
from collections.abc import Iterator
from functools import lru_cache

import zenoh
from typing_extensions import override

from streamkit import (
    TRACKS_CAPS,
    TRACKS_SCHEMA,
    Caps,
    Frame,
    Property,
    ResourceError,
    Source,
    TrackRecord,
    attach_record,
    encode_record,
)
from streamkit_zenoh.keys import FRAME, InvalidKey, records_key, stream_key
from streamkit_zenoh.presence import published_keys
from streamkit_zenoh.receiver import MessageReceiver, ReceivedMessage
from streamkit_zenoh.session import SessionElement, close_session
from streamkit_zenoh.silence import SilenceMonitor
from streamkit_zenoh.wire.encodings import RECORD_LIMIT_BYTES, Encoding, decode_message, encoding_of
from streamkit_zenoh.wire.frame_header import image_frame, read_header
from streamkit_zenoh.wire.images import IMAGE_LIMIT_BYTES, decode_image, image_size
from streamkit_zenoh.wire.numbering import RecentDict

POLL_S = 0.2
LOOK_LIMIT_S = 1.0  # for the answers of publishers with other keys
STOP_LIMIT_S = 2.0
QUEUE_LIMIT_BYTES = 128 * 1024 * 1024
# Reasons of drops, by the count of the receiver.
DROPS = {"lost": "lost on the way", "overwritten": "downstream too slow", "bad": "not a record"}


class Content(enum.StrEnum):
    """The stream that is received."""

    TRACKS = "tracks"
    FRAME = "frame"


class ZenohSrc(SessionElement, Source):
    """Receives what zenohsink publishes: records with Tracks and Registration, or images with all metadata.

    With receive=frame, a pipeline can be split over two machines: detections on one, tracking on the other.
    EOS follows the last record of the last publisher; with eos-on-disconnect=false the element waits for the
    next publisher, whose records have a new epoch. Invalid and lost messages are counted.

    Example:
        zenohsrc key=uav/1 num-buffers=100 timeout-s=10 ! tracksink location=received.jsonl
    """

    is_live = True
    src = "application/x-tracks; video/x-raw, format={ GRAY8, BGR }"
    key: str = Property("streamkit", doc="The key of zenohsink; may have wildcards, uav/*.")
    receive: Content = Property(
        Content.TRACKS, doc="tracks: records from KEY/tracks; frame: images from KEY/frame."
    )
    num_buffers: int = Property(-1, min=-1, doc="Records to pass on before EOS; -1 is no limit.")
    timeout_s: float = Property(
        0.0, min=0.0, unit="s", doc="Fail after so long without a record; 0 never does."
    )
    eos_on_disconnect: bool = Property(True, doc="End when the last publisher is gone.")
    newest: bool = Property(
        False, doc="Drop the oldest records when downstream is slow, instead of blocking the publisher."
    )
    last: bool = Property(False, doc="Start with the last record of a publisher that is already there.")
    max_records: int = Property(1024, min=1, max=100_000, doc="Most records held for downstream.")

    _session: zenoh.Session | None = None
    _receiver: MessageReceiver | None = None

    @override
    def start(self) -> None:
        self._session = self._receiver = None
        self._interrupted = threading.Event()
        self._epoch_base = self._last_epoch = 0
        self._first: tuple[int, int] | None = None
        self._runs: RecentDict[str, int] = RecentDict()
        self._counted: dict[str, int] = {}
        is_frame = self.receive is Content.FRAME
        try:
            self._expression = stream_key(self.key, FRAME) if is_frame else records_key(self.key)
        except InvalidKey as error:
            raise ResourceError(str(error)) from None
        self._session = self.open_zenoh()
        self._receiver = MessageReceiver(
            self._session,
            self._expression,
            capacity=self.max_records,
            max_bytes=QUEUE_LIMIT_BYTES,
            newest=self.newest,
            limit_bytes=IMAGE_LIMIT_BYTES if is_frame else RECORD_LIMIT_BYTES,
            ask_last=self.last,
            ends_with_publisher=self.eos_on_disconnect,
        )

    @override
    def negotiate(self, allowed: Caps) -> Caps | None:
        # The frame size of records, and the caps of images, follow from the first message.
        return TRACKS_CAPS if self.receive is Content.TRACKS else None

    @override
    def frames(self) -> Iterator[Frame]:
        receiver, session = self._receiver, self._session
        assert receiver is not None, "start() precedes frames"
        assert session is not None, "it has a receiver"
        passed = 0
        silence = SilenceMonitor(
            lambda: self.clock_ns() / 1e9,
            lambda: receiver.counts().publishers > 0,
            lambda: published_keys(session, LOOK_LIMIT_S),
        )
        while passed != self.num_buffers and not self._interrupted.is_set():
            message = receiver.queue.get(POLL_S)
            self._count_drops(receiver)
            frame = None if message is None else self._frame(receiver, message)
            if frame is not None:
                silence.reset()
                passed += 1
                yield frame
            elif message is None and receiver.queue.is_over:
                if receiver.has_vanished:
                    self.post_warning(
                        f"the publisher of {self._expression} has gone without ending its stream"
                    )
                return
            elif self.timeout_s and silence.seconds > self.timeout_s:
                raise ResourceError(
                    f"no record at {self._expression} for {self.timeout_s:g} s; "
                    "start the publisher, with the same key and an endpoint that meets this one"
                )
            elif reason := silence.reason():
                self.post_message("note", text=f"no record at {self._expression}{reason}")

    @override
    def interrupt(self) -> None:
        self._interrupted.set()
        if self._receiver is not None:
            self._receiver.queue.close()

    @override
    def stop(self) -> None:
        session, receiver = self._session, self._receiver
        self._session = self._receiver = None
        if receiver is not None:
            receiver.queue.close()
        undeclare = () if receiver is None else receiver.undeclare
        if session is not None and not close_session(session, STOP_LIMIT_S, undeclare=undeclare):
            self.post_warning("zenoh has not closed in time; it ends in the background")
        if receiver is not None:
            self._count_drops(receiver)

    def _count_drops(self, receiver: MessageReceiver) -> None:
        counts = receiver.counts()
        for name, reason in DROPS.items():
            new = getattr(counts, name) - self._counted.get(name, 0)
            if new > 0:
                self.count_drop(reason, new)
                self._counted[name] = getattr(counts, name)
        for text in receiver.warnings():
            self.warn_once(f"{self._expression}: {text}")

    def _frame(self, receiver: MessageReceiver, message: ReceivedMessage) -> Frame | None:
        if message.is_deleted:
            return None
        run = message.stamp.run
        if self._runs.get(message.key, run) != run:
            self._epoch_base = self._last_epoch + 1
        self._runs[message.key] = run
        try:
            frame = self._in_order(self._decoded(message))
        except ValueError as error:
            if not self.drops["not a record"]:
                self.post_warning(f"data at {message.key} is skipped: {error}")
            receiver.count_bad()
            self._count_drops(receiver)
            return None
        self._last_epoch = frame.epoch
        return frame

    def _in_order(self, frame: Frame) -> Frame:
        """The frame, in a new epoch if it precedes the epoch's first frame: publishers differ in time."""
        if frame.pts is not None and self._first is not None and self._first[0] == frame.epoch:
            if frame.pts >= self._first[1]:
                return frame
            self._epoch_base += 1
            frame = frame.replace(epoch=frame.epoch + 1)
        self._first = (frame.epoch, frame.pts or 0)
        return frame

    def _decoded(self, message: ReceivedMessage) -> Frame:
        payload, now_ns = message.payload, self.clock_ns()
        if self.receive is Content.TRACKS:
            record = decode_message(TrackRecord, TRACKS_SCHEMA, message.content_type, payload)
            if encoding_of(message.content_type) is not Encoding.JSON:
                payload = encode_record(record)
            return record_frame(record, payload, now_ns, self._epoch_base)
        header = read_header(message.header)
        if image_size(payload) != (header.picture_width, header.picture_height):
            raise ValueError("the image has another size than its header says")
        return image_frame(decode_image(payload), header, now_ns, self._epoch_base)


def record_frame(record: TrackRecord, payload: bytes, arrival_ns: int, epoch: int) -> Frame:
    """A frame that carries a record: its JSON, its times, and Tracks and Registration as metadata.

    Unknown velocities and covariances are NaN, and so is the homography to the previous frame, which records
    do not hold. `payload` is the record as JSON; `epoch` is added to the record's own.
    """
    frame = Frame(
        payload, _caps(record.width, record.height), pts=record.pts_ns, epoch=epoch + record.epoch,
        seq=record.seq, arrival_ns=arrival_ns, capture=record.capture,
    )  # fmt: skip
    return attach_record(frame, record)


@lru_cache(maxsize=64)
def _caps(width: int | None, height: int | None) -> Caps:
    size = {name: value for name, value in (("width", width), ("height", height)) if value is not None}
    return TRACKS_CAPS.with_fields(**size)
