"""posesync: gives each frame the camera's pose at its time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from typing_extensions import override

from streamkit import (
    SECOND_NS,
    Caps,
    Capture,
    Combine,
    Direction,
    DiscontinuityEvent,
    EosEvent,
    Event,
    Frame,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
)
from streamkit.output.names import local_path
from streamkit_telemetry.samplebuffer import SampleBuffer
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.telemetryreader import NoTelemetry, TelemetryFile, TelemetryReader

TELEMETRY_CAPS = "meta/x-klv; text/x-raw"
HELD_LIMIT = 32
MAX_OFFSET_S = 1e9
# Telemetry may lack a second at both ends of a video of 20 s.
COVERED_SHARE = 0.9


class PoseSync(Combine):
    """Pairs frames with telemetry by time, and attaches `Pose` with the gap to the nearest measurement.

    Telemetry comes in at the pad `telemetry` (KLV or subtitles) or from a separate file. Between two
    samples it is interpolated. A frame waits until telemetry of its time or later is there: live up to
    `wait-ms`, checked whenever a frame or packet arrives, and never for more than 32 frames. A pose whose
    nearest measurement is further away than `max-gap-s` is marked as stale.

    Example:
        filesrc name=s location=flight.ts  s.video ! decode ! posesync name=p ! fakesink  s.klv ! p.telemetry
    """

    sink = src = "ANY"
    templates = (PadTemplate("telemetry", Direction.SINK, Caps(TELEMETRY_CAPS), Presence.REQUEST),)

    location: str = Property("", file="read", doc="File with the video's telemetry: DJI .SRT or raw KLV.")
    max_gap_s: float = Property(
        1.0,
        min=0.0,
        max=MAX_OFFSET_S,
        unit="s",
        doc="A pose whose nearest measurement is further away is stale.",
    )
    offset_s: float = Property(
        0.0, min=-MAX_OFFSET_S, max=MAX_OFFSET_S, unit="s", doc="Added to the telemetry's times."
    )
    wait_ms: int = Property(
        200,
        min=0,
        unit="ms",
        doc="Largest age, since its arrival, of a live frame that still waits for telemetry.",
    )

    def start(self) -> None:
        """Opens the telemetry file, if any; it is read as far as the frames have come."""
        self._samples = SampleBuffer(round(self.max_gap_s * SECOND_NS))
        self._pad_reader = TelemetryReader()
        self._held: deque[Frame] = deque()
        self._epoch = 0
        self._counts = {"frames": 0, "paired": 0, "stale": 0, "without": 0}
        self._largest_gap_ns = 0
        self._telemetry_has_ended = "telemetry" not in self.pads
        self._lacks_stream = False
        video = self.pads["sink"].peer
        self._is_live = video is not None and video.element.query_live()
        self._file: TelemetryFile | None = None
        if self.location:
            with self._reading():
                self._file = TelemetryFile(local_path(self.location))

    @override
    def stop(self) -> None:
        if self._file is not None:
            self._file.close()

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Converts errors of the file."""
        try:
            yield
        except NoTelemetry as error:
            remedy = f"link what a video itself holds, as s.klv ! {self.name}.telemetry"
            raise ResourceError(f"{error}; {remedy}") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ResourceError(f"{self.location}: cannot be read: {reason}; check the path") from None

    def _read_up_to(self, pts: int) -> None:
        """Reads the file up to `pts`; from its beginning if the samples of that time were removed."""
        if self._file is None:
            return
        if self._samples.was_evicted(pts):
            self._forget()
        with self._reading():
            while not self._samples.covers(pts) and (sample := self._file.next()) is not None:
                self._add(replace(sample, pts=sample.pts + self._begin_ns()))
        self._warn_of_damage(self._file.reader)

    def _begin_ns(self) -> int:
        """When the video begins, as the times of the file do; a transport stream begins at any time."""
        video = self.pads["sink"].peer
        return 0 if video is None else video.element.query_begin_ns()

    def _forget(self) -> None:
        """Restarts with other timestamps."""
        self._samples.clear()
        if self._file is not None:
            with self._reading():
                self._file.rewind()

    # Negotiation: the video passes as it is.

    def query_caps(self, pad: Any) -> Caps:
        """Frames pass unchanged from sink to src; the telemetry pad takes what it can read."""
        if pad.name == "telemetry":
            return Caps(TELEMETRY_CAPS)
        other = self.pads["sink" if pad.is_src else "src"]
        return Caps("ANY") if other.peer is None else other.peer_caps()

    def send_segment(self, pad: Any) -> None:
        """The segment downstream is always the video's."""
        super().send_segment(self.pads["sink"])

    # Streaming.

    def combine(self, pad_name: str, frame: Frame) -> Iterator[Frame]:
        """Adds telemetry or queues a frame; yields the frames that need not wait."""
        if frame.epoch != self._epoch:
            yield from self._release(is_end=True)
            self._epoch = frame.epoch
            self._forget()
        if pad_name == "telemetry":
            for sample in self._pad_reader.packet(frame.data, frame.caps.name, frame.pts):
                self._add(sample)
            self._warn_of_damage(self._pad_reader)
        else:
            self._held.append(frame)
        yield from self._release()

    def receive_event(self, pad: Any, event: Event) -> None:
        """Events of the telemetry pad end here; after its EOS frames do not wait."""
        if pad.name != "telemetry":
            if isinstance(event, DiscontinuityEvent):
                self._push_all(is_end=True)
            super().receive_event(pad, event)
        elif isinstance(event, EosEvent):
            with self.combine_lock:
                for sample in self._pad_reader.finish():
                    self._add(sample)
                self._telemetry_has_ended = True
                # The source, which has warned of it, ends a pad without a stream before its first frame.
                has_begun = self._held or self._counts["frames"]
                self._lacks_stream = self._file is None and not has_begun
            self._push_all(is_end=False)
            super().receive_event(pad, event)

    def drain(self) -> Iterator[Frame]:
        """The last frames, with the poses there are; the counts are posted."""
        yield from self._release(is_end=True)
        counts, described = self._pad_reader.counts(), self._pad_reader.describe()
        self._warn_of_damage(self._pad_reader, at_end=True)
        if self._file is not None:
            self._warn_of_damage(self._file.reader, at_end=True)
            counts = {name: count + counts[name] for name, count in self._file.reader.counts().items()}
            described = f"in the file {self._file.reader.describe()}"
        self.post_message("telemetry", **self._counts, **counts, largest_gap_ns=self._largest_gap_ns)
        paired, frames = self._counts["paired"], self._counts["frames"]
        if not any(counts.values()):
            if not self._lacks_stream:
                self.post_warning(
                    "no frame has got a pose: no telemetry came; link the source's klv or subtitle to "
                    f"{self.name}.telemetry, or set location=FILE; `streamkit doctor` says what a video has",
                    "shortfall",
                )
        elif not paired:
            self.post_warning(
                f"no frame of {frames} has got a pose: {described}; check that the telemetry is of this "
                "flight and its times fit (offset-s=)",
                "shortfall",
            )
        elif paired < COVERED_SHARE * frames:
            self.post_warning(
                f"only {paired} of {frames} frames have got a pose: the telemetry does not cover the "
                f"others; {described}",
                "shortfall",
            )

    def _push_all(self, *, is_end: bool) -> None:
        with self.combine_lock:
            for frame in self._release(is_end=is_end):
                self.push_output(frame, self.pads["sink"])

    def _release(self, *, is_end: bool = False) -> Iterator[Frame]:
        while self._held and (is_end or self._is_due(self._held[0])):
            yield self._with_pose(self._held.popleft())

    def _is_due(self, frame: Frame) -> bool:
        if self._telemetry_has_ended or len(self._held) > HELD_LIMIT or frame.pts is None:
            return True
        self._read_up_to(frame.pts)
        if self._samples.covers(frame.pts):
            return True
        waited_ns = self.clock_ns() - frame.arrival_ns
        return self._is_live and waited_ns > self.wait_ms * 1_000_000

    def _with_pose(self, frame: Frame) -> Frame:
        self._counts["frames"] += 1
        found = None
        if frame.pts is not None:
            self._read_up_to(frame.pts)
            found = self._samples.sample_at(frame.pts)
        if found is None:
            self._counts["without"] += 1
            return frame
        sample, gap_ns, is_stale = found
        self._counts["stale" if is_stale else "paired"] += 1
        self._largest_gap_ns = max(self._largest_gap_ns, abs(gap_ns))
        frame = frame.attach(replace(sample.pose, gap_ns=gap_ns, is_stale=is_stale), sample)
        if is_stale or sample.utc_ns is None or (frame.capture and frame.capture.origin == "rtcp"):
            return frame
        return frame.replace(capture=Capture(sample.utc_ns, "misb"))

    def _add(self, sample: Sample) -> None:
        """Adds a sample, its time shifted by the offset."""
        shift = round(self.offset_s * SECOND_NS)
        self._samples.add(replace(sample, pts=sample.pts + shift) if shift else sample)

    def _warn_of_damage(self, reader: TelemetryReader, at_end: bool = False) -> None:
        """Posts a warning at the first damage, each time its count has doubled, and at the end."""
        if complaint := reader.complaint(at_end):
            self.post_warning(complaint)
