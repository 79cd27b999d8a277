"""identity: passes frames on as they are; made for tests of what a pipeline does."""

from __future__ import annotations

import random
from typing import Any

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.elements.callbacks import Callbacks
from streamkit.elements.frame_text import dump_text, frame_text
from streamkit.errors import PropertyError, StreamError
from streamkit.flow.events import Event, GapEvent, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.flow.segment import OPEN_SEGMENT, Segment
from streamkit.flow.signals import EndOfStream, Flushing
from streamkit.handoff.frame_queue import data_size

INT = 2**31 - 1
INT64 = 2**63 - 1
FLAGS = {"discont": FrameFlags.DISCONTINUITY, "corrupted": FrameFlags.CORRUPT}
DELTA_UNIT = "delta-unit"  # a frame that is no keyframe; only coded streams tell them apart
NEVER_SET = (  # GStreamer's other marks, which no frame here has
    "live", "decode-only", "resync", "marker", "header", "gap", "droppable", "tag-memory", "sync-after",
    "non-droppable", "last",
)  # fmt: skip


class Identity(Transform):
    """Passes every frame on; may drop, delay, stamp or fail on purpose.

    Where nothing is to be done it costs nothing, and frames pass it unseen.

    Attributes:
        on_handoff: called with the frame before it goes on, while `signal-handoffs` is on. Add callables
            before the pipeline plays.

    Example:
        fakesrc num-buffers=10 ! identity drop-probability=0.5 ! fakesink
    """

    sink = src = "ANY"

    sleep_time: int = Property(
        0, min=0, max=2**32 - 1, unit="us", doc="Time to wait before each frame goes on."
    )
    error_after: int = Property(-1, min=-1, max=INT, doc="Fails at the n-th frame; -1 is never.")
    eos_after: int = Property(-1, min=-1, max=INT, doc="Ends the stream at the n-th frame; -1 is never.")
    drop_probability: float = Property(0.0, min=0.0, max=1.0, doc="Share of frames dropped at random.")
    drop_buffer_flags: str = Property(
        "", doc="Drop frames with any of these marks, joined by `+`: discont, corrupted, delta-unit."
    )
    datarate: int = Property(
        0, min=0, max=INT, unit="bytes/s", doc="Stamps frames as if so much came a second; 0 is no stamp."
    )
    single_segment: bool = Property(
        False, doc="Stamp frames with their running time, so that all lie in one segment."
    )
    sync: bool = Property(False, doc="Hold each frame until its time has come, on the pipeline's clock.")
    ts_offset: int = Property(0, min=-INT64 - 1, max=INT64, unit="ns", doc="With sync: hold so much longer.")
    silent: bool = Property(True, doc="Post no message for each frame.")
    signal_handoffs: bool = Property(True, doc="Call `on_handoff` with each frame.")
    dump: bool = Property(False, doc="Post the bytes of each frame as a message.")
    check_imperfect_timestamp: bool = Property(
        False, doc="Post a message where a timestamp is not the end of the frame before."
    )
    check_imperfect_offset: bool = Property(False, doc="Post a message where a frame's number skips one.")
    last_message: str | None = Property(None, readonly=True, doc="What was last done, unless silent.")
    stats: str = Property(
        "", read=lambda identity: identity._stats(), doc="Frames and bytes looked at; none pass as they are."
    )
    seed: int = Property(0, doc="Of the random choice.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_handoff = Callbacks()
        self._flags = 0
        self._drops_delta_units = False
        self._random = random.Random(0)
        self._count = self._bytes = 0
        self._end_ns: int | None = None
        self._number: int | None = None
        super().__init__(name, **properties)

    def property_changed(self, name: str) -> None:
        """Reads the marks to drop."""
        if name != "drop_buffer_flags":
            return
        words = [word for word in self.drop_buffer_flags.split("+") if word]
        unknown = [word for word in words if word not in (*FLAGS, DELTA_UNIT, *NEVER_SET)]
        if unknown:
            raise PropertyError(
                f"{self.name}: property drop-buffer-flags cannot be {self.drop_buffer_flags!r}: it takes "
                f"{', '.join((*FLAGS, DELTA_UNIT, *NEVER_SET))}, joined by +"
            )
        self._flags = sum(FLAGS[word] for word in words if word in FLAGS)
        self._drops_delta_units = DELTA_UNIT in words

    def start(self) -> None:
        """Begins to count."""
        self._random = random.Random(self.seed)
        self._count = self._bytes = 0
        self._end_ns = self._number = None

    def _stats(self) -> str:
        return f"application/x-identity-stats, num-bytes={self._bytes}, num-buffers={self._count}"

    def is_passthrough(self) -> bool:
        """Whether nothing is to be done."""
        return self.silent and not any((
            self.drop_probability, self.sleep_time, self.error_after >= 0, self.eos_after >= 0, self._flags,
            self._drops_delta_units, self.datarate, self.single_segment, self.sync, self.dump,
            self.signal_handoffs and self.on_handoff, self.check_imperfect_timestamp,
            self.check_imperfect_offset,
        ))  # fmt: skip

    def transform(self, frame: Frame) -> Frame | None:
        """Counts, checks, drops, stamps and delays, in GStreamer's order."""
        self._count += 1
        self._bytes += data_size(frame.data)
        if self.check_imperfect_timestamp:
            self._check_timestamp(frame)
        if self.check_imperfect_offset:
            self._check_number(frame)
        if self._count == self.error_after:
            raise StreamError(f"error-after={self.error_after}: the frame at which to fail has come")
        if self._is_dropped(frame):
            return None
        if self._count == self.eos_after:
            raise EndOfStream(self.name)
        self._tell(frame)
        frame = self._stamped(frame)
        if self.sync and frame.pts is not None:
            self._hold(frame.pts)
        if self.sleep_time:
            with self.waiting():
                self.stopping.wait(self.sleep_time / 1e6)
        return frame

    def _is_dropped(self, frame: Frame) -> bool:
        marked = frame.flags & self._flags or (
            self._drops_delta_units and not frame.flags & FrameFlags.KEYFRAME
        )
        if marked:
            self.count_drop("drop-buffer-flags")
            return True
        if self.drop_probability and self._random.random() < self.drop_probability:
            self.count_drop("drop-probability")
            return True
        return False

    def _tell(self, frame: Frame) -> None:
        if not self.silent:
            self.last_message = frame_text("chain", self.pads["sink"], frame)
            self.post_message("frame", seq=frame.seq, pts=frame.pts, caps=str(frame.caps))
        if self.dump:
            self.post_message("dump", content=dump_text(frame))
        if self.signal_handoffs:
            self.on_handoff.emit(frame)

    def _stamped(self, frame: Frame) -> Frame:
        if self.datarate:
            size = data_size(frame.data)
            begin = (self._bytes - size) * 1_000_000_000 // self.datarate
            return frame.replace(pts=begin, duration=size * 1_000_000_000 // self.datarate)
        if self.single_segment and frame.pts is not None:
            return frame.replace(pts=self.pads["sink"].segment.running_time_ns(frame.pts))
        return frame

    def _hold(self, pts_ns: int) -> None:
        """Waits for the running time of a timestamp."""
        segment = OPEN_SEGMENT if self.single_segment else self.pads["sink"].segment
        if not self.wait_until_due(segment.running_time_ns(pts_ns) + self.ts_offset):
            raise Flushing(self.name)

    def _check_timestamp(self, frame: Frame) -> None:
        if frame.pts is not None and self._end_ns is not None and frame.pts != self._end_ns:
            self.post_message("imperfect-timestamp", expected_ns=self._end_ns, pts=frame.pts)
        if frame.pts is not None:
            self._end_ns = frame.pts + frame.duration if frame.duration is not None else None

    def _check_number(self, frame: Frame) -> None:
        if self._number is not None and frame.seq != self._number + 1:
            self.post_message("imperfect-offset", expected=self._number + 1, seq=frame.seq)
        self._number = frame.seq

    def pass_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Passes events on; with `single-segment` only one segment goes out."""
        if self.single_segment and isinstance(event, SegmentEvent):
            event = SegmentEvent(Segment())
        if self.single_segment and isinstance(event, GapEvent) and event.pts is not None:
            event = GapEvent(pad.segment.running_time_ns(event.pts), event.duration)
        return super().pass_event(pad, event)
