"""identity: forwards frames unchanged; for tests of pipelines."""

from __future__ import annotations

import random
from typing import Any

from typing_extensions import override

from streamkit.element.frame_queue import data_size
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import INT, INT64, UINT
from streamkit.element.transform import Transform
from streamkit.elements.frame_report import Callbacks, report_frame
from streamkit.errors import PropertyError, StreamError
from streamkit.flow.events import OPEN_SEGMENT, EndOfStream, Event, Flushing, GapEvent, Segment, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags

FLAGS = {"discont": FrameFlags.DISCONTINUITY, "corrupted": FrameFlags.CORRUPT}
DELTA_UNIT = "delta-unit"  # not a keyframe; only coded streams distinguish them
NEVER_SET = (  # GStreamer's other flags, which frames here do not have
    "live", "decode-only", "resync", "marker", "header", "gap", "droppable", "tag-memory", "sync-after",
    "non-droppable", "last",
)  # fmt: skip


class Identity(Transform):
    """Forwards every frame; can drop, delay, timestamp or fail on purpose.

    Without such properties frames bypass it at no cost.

    Attributes:
        on_handoff: called with each frame if `signal-handoffs` is on; add functions before playing.

    Example:
        fakesrc num-buffers=10 ! identity drop-probability=0.5 ! fakesink
    """

    sink = src = "ANY"

    sleep_time: int = Property(0, min=0, max=UINT, unit="us", doc="Delay of each frame; counts as work.")
    error_after: int = Property(-1, min=-1, max=INT, doc="Fails at the n-th frame; -1 is never.")
    eos_after: int = Property(-1, min=-1, max=INT, doc="Ends the stream at the n-th frame; -1 is never.")
    drop_probability: float = Property(0.0, min=0.0, max=1.0, doc="Probability that a frame is dropped.")
    drop_buffer_flags: str = Property(
        "", doc="Drop frames with any of these flags, joined by `+`: discont, corrupted, delta-unit."
    )
    datarate: int = Property(0, min=0, max=INT, unit="bytes/s", doc="Timestamps by this rate; 0 is off.")
    single_segment: bool = Property(False, doc="Replace timestamps by running time, in one segment.")
    sync: bool = Property(False, doc="Forward each frame at its running time.")
    ts_offset: int = Property(0, min=-INT64 - 1, max=INT64, unit="ns", doc="With sync: delay of each frame.")
    silent: bool = Property(True, doc="Post no message for each frame.")
    signal_handoffs: bool = Property(True, doc="Call `on_handoff` with each frame.")
    dump: bool = Property(False, doc="Post the bytes of each frame as a message.")
    check_imperfect_timestamp: bool = Property(
        False, doc="Post a message at gaps and overlaps in timestamps."
    )
    check_imperfect_offset: bool = Property(False, doc="Post a message if frame numbers are not consecutive.")
    last_message: str | None = Property(None, readonly=True, doc="The last action, unless silent.")
    stats: str = Property(
        "",
        read=lambda identity: identity._stats(),
        doc="Frames and bytes processed; none while they bypass it.",
    )
    seed: int = Property(0, doc="Seed of random drops.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_handoff = Callbacks()
        self._flags = 0
        self._drops_delta_units = False
        super().__init__(name, **properties)

    @override
    def property_changed(self, name: str) -> None:
        if name != "drop_buffer_flags":
            return
        words, known = self.drop_buffer_flags.split("+"), (*FLAGS, DELTA_UNIT, *NEVER_SET)
        if not {*words} <= {"", *known}:
            raise PropertyError(
                f"{self.name}: property drop-buffer-flags cannot be {self.drop_buffer_flags!r}: it takes "
                f"{', '.join(known)}, joined by +"
            )
        self._flags = sum(FLAGS[word] for word in words if word in FLAGS)
        self._drops_delta_units = DELTA_UNIT in words

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._random = random.Random(self.seed)
        self._count = self._bytes = 0
        self._end_ns: int | None = None
        self._number: int | None = None

    def _stats(self) -> str:
        return f"application/x-identity-stats, num-bytes={self._bytes}, num-buffers={self._count}"

    def is_passthrough(self) -> bool:
        """Whether no property asks for work."""
        return self.silent and not any((
            self.drop_probability, self.sleep_time, self.error_after >= 0, self.eos_after >= 0, self._flags,
            self._drops_delta_units, self.datarate, self.single_segment, self.sync, self.dump,
            self.signal_handoffs and self.on_handoff, self.check_imperfect_timestamp,
            self.check_imperfect_offset,
        ))  # fmt: skip

    @override
    def transform(self, frame: Frame) -> Frame | None:
        self._count += 1
        self._bytes += data_size(frame.data)
        if self.check_imperfect_timestamp:
            self._check_timestamp(frame)
        if self.check_imperfect_offset:
            self._check_number(frame)
        if self._count == self.error_after:
            raise StreamError(f"error-after={self.error_after}: the frame at which to fail has come")
        if self._drop(frame):
            return None
        if 0 < self.eos_after <= self._count:  # upstream may have more, as a decoder has at the end
            raise EndOfStream(self.name)
        report_frame(self, "chain", self.pads["sink"], frame, frame)
        frame = self._timestamped(frame)
        if self.sync and frame.pts is not None:
            self._hold(frame.pts)
        if self.sleep_time:
            self.stopping.wait(self.sleep_time / 1e6)
        return frame

    def _drop(self, frame: Frame) -> bool:
        """Drops and counts a frame if the properties say so; whether it did."""
        is_delta_unit = not frame.flags & FrameFlags.KEYFRAME
        if frame.flags & self._flags or (self._drops_delta_units and is_delta_unit):
            self.count_drop("drop-buffer-flags")
            return True
        if self.drop_probability and self._random.random() < self.drop_probability:
            self.count_drop("drop-probability")
            return True
        return False

    def _timestamped(self, frame: Frame) -> Frame:
        if self.datarate:
            size = data_size(frame.data)
            begin = (self._bytes - size) * 1_000_000_000 // self.datarate
            return frame.replace(pts=begin, duration=size * 1_000_000_000 // self.datarate)
        if self.single_segment and frame.pts is not None:
            return frame.replace(pts=self.pads["sink"].segment.running_time_ns(frame.pts))
        return frame

    def _hold(self, pts_ns: int) -> None:
        """Waits until the running time of a timestamp."""
        segment = OPEN_SEGMENT if self.single_segment else self.pads["sink"].segment
        if not self.wait_until_due(segment.running_time_ns(pts_ns), self.ts_offset):
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

    def receive_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Forwards events; replaces segments with `single-segment`."""
        if self.single_segment and isinstance(event, SegmentEvent):
            event = SegmentEvent(Segment())
        if self.single_segment and isinstance(event, GapEvent) and event.pts is not None:
            event = GapEvent(pad.segment.running_time_ns(event.pts), event.duration)
        return super().receive_event(pad, event)
