"""The status record: how a publisher is doing, once a second."""

from __future__ import annotations

from typing import Literal

import msgspec

STATUS_SCHEMA: Literal["streamkit.status/1"] = "streamkit.status/1"


class StreamStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of a publisher.

    Attributes:
        name: tracks, frame, mosaic or status.
        run: when its publisher began, UTC ns; the first word of every attachment.
        settled_number: every message with a lower number has been sent or dropped: whoever has not heard it,
            will not.
        published: messages given to zenoh.
        bytes: their size together.
        has_subscriber: 1 while anybody listens, else 0.
        next_number: the next message gets it; whoever asked for this and listened is sent all from there on.
        first_number: in an answer to a receiver that shows itself: it is sent all from there on.
    """

    name: str
    run: int
    settled_number: int
    published: int
    bytes: int
    has_subscriber: int
    next_number: int = 0
    first_number: int | None = None


class DropCount(msgspec.Struct, frozen=True, kw_only=True):
    """Messages that the publisher itself has not delivered."""

    stream: str
    reason: str
    count: int


class StatusRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How a publisher is doing; what is not known is left out.

    Attributes:
        schema: name and version of this form.
        source: the publisher's key.
        state: starting until the first frame, then playing, and ended at the end of the stream.
        run: when the publisher began, UTC ns.
        published_ns: UTC.
        uptime_s: since it began.
        frames: frames that came in.
        seq: number of the last frame.
        epoch: of the last frame.
        tracks: targets in the last frame.
        age_ms: from capture to publishing, of the last record published.
        streams: what it publishes.
        drops: what it has not delivered, by stream and reason.
    """

    schema: Literal["streamkit.status/1"]
    source: str
    state: Literal["starting", "playing", "ended"]
    run: int
    published_ns: int
    uptime_s: float
    frames: int
    seq: int | None = None
    epoch: int | None = None
    tracks: int
    age_ms: float | None = None
    streams: tuple[StreamStatus, ...]
    drops: tuple[DropCount, ...]
