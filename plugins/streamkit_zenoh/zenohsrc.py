"""zenohsrc: track records or pictures from zenoh, as frames with their metadata."""

import enum
import threading
from collections import OrderedDict
from collections.abc import Iterator

import zenoh

from streamkit import TRACKS_CAPS, Caps, Frame, Property, ResourceError, Source, encode_record
from streamkit_zenoh.connection import Connection
from streamkit_zenoh.keys import FRAME, InvalidKey, records_key, stream_key
from streamkit_zenoh.receive.decoding import RecordDecoder
from streamkit_zenoh.receive.mailbox import Mailbox
from streamkit_zenoh.receive.reception import Received, Reception
from streamkit_zenoh.session import close_session
from streamkit_zenoh.wire.forms import RECORD_LIMIT_BYTES, Form, form_of
from streamkit_zenoh.wire.frame_header import picture_frame, read_header
from streamkit_zenoh.wire.numbering import remember
from streamkit_zenoh.wire.pictures import PICTURE_LIMIT_BYTES, decode_picture, picture_size
from streamkit_zenoh.wire.records import record_frame
from streamkit_zenoh.wire.sequence import JUMP_WARNING

LOOK_EVERY_S = 0.2
STOP_LIMIT_S = 2.0
HELD_LIMIT_BYTES = 128 * 1024 * 1024


class Content(enum.StrEnum):
    """What is received."""

    TRACKS = "tracks"
    FRAME = "frame"


class ZenohSrc(Connection, Source):
    """Receives what zenohsink publishes: records with Tracks and Registration, or pictures with all metadata.

    With receive=frame, a pipeline may be split over two machines: detections on one, tracking on the other.
    Ends when the last publisher has gone, behind its last record; with eos-on-disconnect=false it waits for
    the next one, whose records come in a new epoch. Data that is not what it should be is counted and
    skipped, and so is what was lost on the way.

    Example:
        zenohsrc key=uav/1 num-buffers=100 timeout-s=10 ! tracksink location=received.jsonl
    """

    is_live = True
    src = "application/x-tracks; video/x-raw, format={ GRAY8, BGR }"
    key: str = Property("streamkit", doc="What zenohsink has as key; may have wildcards, uav/*.")
    receive: Content = Property(
        Content.TRACKS, doc="tracks: records from KEY/tracks; frame: pictures from KEY/frame."
    )
    num_buffers: int = Property(-1, min=-1, doc="Records to pass on before EOS; -1 is no limit.")
    timeout_s: float = Property(
        0.0, min=0.0, unit="s", doc="Fail after so long without a record; 0 never does."
    )
    eos_on_disconnect: bool = Property(True, doc="End when the last publisher has gone.")
    newest: bool = Property(
        False, doc="Drop the oldest records when downstream is slow, instead of holding up the publisher."
    )
    last: bool = Property(False, doc="Begin with the last record of a publisher that is there already.")
    max_records: int = Property(1024, min=1, max=100_000, doc="Records held for downstream.")

    _session: zenoh.Session | None = None
    _reception: Reception | None = None

    def start(self) -> None:
        """Opens the session and listens; records are held until frames are asked for."""
        self._session = self._reception = None
        self._interrupted = threading.Event()
        self._epoch_base = self._last_epoch = 0
        self._first: tuple[int, int] | None = None
        self._runs: OrderedDict[str, int] = OrderedDict()
        self._decoder = RecordDecoder()
        self._counted: dict[str, int] = {}
        self._has_warned_of_jumps = False
        self._box: Mailbox[Received] = Mailbox(self.max_records, HELD_LIMIT_BYTES, self.newest)
        is_frame = self.receive is Content.FRAME
        try:
            self._expression = stream_key(self.key, FRAME) if is_frame else records_key(self.key)
        except InvalidKey as error:
            raise ResourceError(str(error)) from None
        self._session = self.open_zenoh()
        limit_bytes = PICTURE_LIMIT_BYTES if is_frame else RECORD_LIMIT_BYTES
        self._reception = Reception(
            self._session, self._expression, self._box, limit_bytes, self.last, self._publishers_changed
        )

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps of records; their frame size, and all of a picture, are told by the first one."""
        return TRACKS_CAPS if self.receive is Content.TRACKS else None

    def frames(self) -> Iterator[Frame]:
        """Records or pictures in order, as frames."""
        passed, heard_ns = 0, self.clock_ns()
        while passed != self.num_buffers and not self._interrupted.is_set():
            item = self._box.take(LOOK_EVERY_S)
            self._count_drops()
            frame = None if item is None else self._frame(item)
            if frame is not None:
                heard_ns = self.clock_ns()
                passed += 1
                yield frame
            elif item is None and self._box.is_over:
                if self._reception is not None and self._reception.has_vanished:
                    self.post_warning(
                        f"the publisher of {self._expression} has gone without ending its stream"
                    )
                return
            elif self.timeout_s and (self.clock_ns() - heard_ns) / 1e9 > self.timeout_s:
                raise ResourceError(
                    f"no record at {self._expression} for {self.timeout_s:g} s; "
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
            declared = self._reception.declared if self._reception is not None else ()
            if not close_session(session, STOP_LIMIT_S, undeclare=declared):
                self.post_warning("zenoh has not closed in time; it ends in the background")
            self._count_drops()

    def _publishers_changed(self, count: int) -> None:
        if self.eos_on_disconnect:
            self._box.end(count == 0)

    def _count_drops(self) -> None:
        if self._reception is None:
            return
        counts = self._reception.counts()
        found = {
            "lost on the way": counts.lost,
            "downstream too slow": counts.overwritten,
            "not a record": counts.bad,
        }
        for reason, count in found.items():
            if count > self._counted.get(reason, 0):
                self.count_drop(reason, count - self._counted.get(reason, 0))
                self._counted[reason] = count
        if counts.jumps and not self._has_warned_of_jumps:
            self._has_warned_of_jumps = True
            self.post_warning(f"{self._expression}: {JUMP_WARNING}")

    def _frame(self, item: Received) -> Frame | None:
        if item.is_deleted or self._reception is None:
            return None
        if self._runs.get(item.key, item.run) != item.run:
            self._epoch_base = self._last_epoch + 1
        remember(self._runs, item.key, item.run)
        try:
            frame = self._picture(item) if self.receive is Content.FRAME else self._record(item)
        except ValueError as error:
            if not self.drops["not a record"]:
                self.post_warning(f"data at {item.key} is skipped: {error}")
            self._reception.count_bad()
            self._count_drops()
            return None
        frame = self._in_time(frame)
        self._last_epoch = frame.epoch
        return frame

    def _in_time(self, frame: Frame) -> Frame:
        """The frame, in a new epoch where its time lies before the first one's: publishers differ in time."""
        if frame.pts is not None and self._first is not None and self._first[0] == frame.epoch:
            if frame.pts >= self._first[1]:
                return frame
            self._epoch_base += 1
            frame = frame.replace(epoch=frame.epoch + 1)
        self._first = (frame.epoch, frame.pts or 0)
        return frame

    def _record(self, item: Received) -> Frame:
        record = self._decoder.decode(item)
        payload = item.payload if form_of(item.encoding) is Form.JSON else encode_record(record)
        return record_frame(record, payload, self.clock_ns(), self._epoch_base)

    def _picture(self, item: Received) -> Frame:
        header = read_header(item.header)
        if picture_size(item.payload) != (header.picture_width, header.picture_height):
            raise ValueError("the picture has another size than its header says")
        return picture_frame(decode_picture(item.payload), header, self.clock_ns(), self._epoch_base)
