"""Plays a stream for a while and records what comes out of it."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, cast

from streamkit import ElementFailure, Frame, FrameFlags, Message, Pipeline, StreamkitError
from streamkit_media.decoding.presentation_times import WRONG_TIMES_CODE
from streamkit_media.doctor.measure import PacketFacts
from streamkit_media.streams import DecodeOnly
from streamkit_telemetry_formats.photograph import sample_of_photograph
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.telemetryreader import TelemetryReader

POLL_S = 0.1
TELEMETRY_PADS = {"filesrc": ("klv", "klv_1", "subtitle"), "rtspsrc": ("klv",), "livesrc": ("klv", "klv_1")}
KEPT_PACKETS, KEPT_BYTES = 150, 1 << 26


class Seen:
    """What came out of a stream."""

    def __init__(self) -> None:
        self.packets: list[PacketFacts] = []  # of the video
        self.kept: list[Frame] = []  # the first of them whole, to try whether they decode
        self._kept_bytes = 0
        self.origins = Counter[str]()  # of the capture times
        self.telemetry: dict[str, TelemetryReader] = {}  # a reader for each telemetry pad
        self.carrier = ""  # of a live stream: tcp, udp or its scheme
        self.unread_videos: list[int] = []  # streams of further videos
        self.are_times_wrong = False  # whether a file stores times in order of coding
        self.error = ""  # the one that ended it, or ""
        self.shortfall = ""  # of a file that is cut short: where it ends, and where it should

    def add_video(self, frame: Frame) -> None:
        """Takes a packet of the video."""
        size, is_key = memoryview(frame.data).nbytes, bool(frame.flags & FrameFlags.KEYFRAME)
        if not self.kept or (len(self.kept) < KEPT_PACKETS and self._kept_bytes + size <= KEPT_BYTES):
            self.kept.append(frame)
            self._kept_bytes += size
        is_shown = frame.get(DecodeOnly) is None
        self.packets.append(PacketFacts(frame.pts, frame.arrival_ns, size, is_key, is_shown))
        if frame.capture is not None:
            self.origins[frame.capture.origin] += 1

    def add_telemetry(self, pad: str, packet: Frame) -> None:
        """Takes a packet of a telemetry pad."""
        reader = self.telemetry.setdefault(pad, TelemetryReader())
        reader.packet(packet.data, packet.caps.name, packet.pts)

    @property
    def photograph(self) -> Sample | None:
        """Position in the header of an image file; None for a video, or where the file has none."""
        is_image = len(self.packets) == 1 and self.kept[0].caps.name.startswith("image/")
        return sample_of_photograph(bytes(self.kept[0].data), 0) if is_image else None

    @property
    def best_telemetry(self) -> tuple[str, dict[str, int]]:
        """The pad that gave most positions, or else most packets, and its counts."""
        found = [(pad, decoder.counts()) for pad, decoder in self.telemetry.items()]
        nothing = ("", TelemetryReader().counts())
        return max(found, key=lambda item: (item[1]["poses"], item[1]["good_packets"]), default=nothing)


def watch(
    factory: str,
    properties: Mapping[str, Any],
    limit_s: float,
    seconds: float | None,
    most_packets: float = math.inf,
) -> Seen:
    """Plays a source and records what comes out of it, until its end or for some seconds.

    Args:
        factory: filesrc, rtspsrc or livesrc.
        properties: of the source.
        limit_s: longest wait for the first packet, and for a file altogether.
        seconds: how long to watch a live stream from its first packet on; None plays a file to its end.
        most_packets: of the video of a file; no more are read.
    """
    seen = Seen()
    full = "max-buffers=1000 drop=true" if seconds is not None else ""
    pads = TELEMETRY_PADS[factory]
    telemetry = "  ".join(f"s.{pad} ! appsink name={pad} {full}" for pad in pads)
    text = f"{factory} name=s  s.src ! appsink name=video {full}  {telemetry}"
    until_s = time.monotonic() + limit_s

    def watch_messages(message: Message) -> None:
        if message.fields.get("name") == "cut-short":
            seen.shortfall = str(message.fields["text"])
        seen.are_times_wrong |= message.fields.get("code") == WRONG_TIMES_CODE

    error: Exception | None = None
    try:
        with Pipeline.parse(text) as pipeline:
            pipeline.bus.watch(watch_messages)  # without one, an error that is not read would be logged, too
            for name, value in properties.items():
                pipeline["s"].set_property(name, value)
            pipeline.play()
            _record(pipeline, seen, pads, until_s, seconds, most_packets)
            seen.carrier = getattr(pipeline["s"], "carrier", "")
            seen.unread_videos = pipeline["s"].unread_videos
            error = pipeline.error
    except StreamkitError as failure:
        error = failure
    if seconds is None:
        for reader in seen.telemetry.values():  # what they held back counts too
            reader.finish()
    # Without the name of the element.
    seen.error = str((error.__cause__ or error) if isinstance(error, ElementFailure) else error or "")
    return seen


def _record(
    pipeline: Pipeline, seen: Seen, pads: Sequence[str], until_s: float, seconds: float | None, most: float
) -> None:
    """Takes what comes out until the end, `until_s`, `seconds` after the first packet, or `most` packets."""
    while len(seen.packets) < most and time.monotonic() < until_s:
        frame = _pull(pipeline["video"], POLL_S)
        has_ended = frame is None and (pipeline.ended.is_set() or pipeline.error is not None)
        if frame is not None:
            if not seen.packets and seconds is not None:
                until_s = time.monotonic() + seconds
            seen.add_video(frame)
        for pad in pads:
            while (packet := _pull(pipeline[pad], 0.0)) is not None:
                seen.add_telemetry(pad, packet)
        if has_ended:
            return


def _pull(sink: Any, timeout_s: float) -> Frame | None:
    with suppress(StreamkitError):
        return cast("Frame | None", sink.pull(timeout_s))
    return None
