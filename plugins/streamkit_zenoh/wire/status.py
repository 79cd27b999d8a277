"""The status record, which a publisher sends once a second."""

from __future__ import annotations

from typing import Literal

import msgspec

STATUS_SCHEMA: Literal["streamkit.status/1"] = "streamkit.status/1"


class StreamStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of a publisher.

    Attributes:
        name: tracks, frame, mosaic or status.
        run: when its publisher began, UTC ns; the first word of every attachment.
        settled_number: all messages with lower numbers were sent or dropped; those not received are lost.
        published: messages passed to zenoh.
        bytes: their total size.
        has_subscriber: 1 while there is a subscriber, else 0.
        next_number: of the next message; a subscriber that asked for this status is sent all from it on.
        first_number: in a reply to a receiver with a token: it is sent all from this number on.
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
    """Messages that the publisher dropped."""

    stream: str
    reason: str
    count: int


class PropertyChange(msgspec.Struct, frozen=True, kw_only=True):
    """A property that was set over KEY/control, with its value as text."""

    element: str
    property: str
    value: str


class ElementDrop(msgspec.Struct, frozen=True, kw_only=True):
    """Frames that an element dropped."""

    reason: str
    count: int


class ElementStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One element of the publisher's pipeline, since streaming began.

    Attributes:
        name: behind that of its bin.
        busy_ns: working time; 0 of a queue.
        drops: frames that it dropped, by reason.
    """

    name: str
    busy_ns: int
    drops: tuple[ElementDrop, ...]


class StatusRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """State and counters of a publisher; unknown values are left out.

    Attributes:
        schema: name and version of the schema.
        source: the publisher's key.
        state: starting until the first frame, then playing, and ended at the end of the stream.
        run: when the publisher began, UTC ns.
        published_ns: UTC.
        uptime_s: since it began.
        frames: frames received.
        seq: sequence number of the last frame.
        epoch: of the last frame.
        tracks: targets in the last frame.
        age_ms: from capture to publishing, of the last record.
        streams: its streams but this one.
        drops: messages it dropped, by stream and reason.
        control: whether live properties can be set at KEY/control.
        changes: properties that were set there, each with its last value.
        elements: of the pipeline, but for those in processes of their own.
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
    control: bool = False
    changes: tuple[PropertyChange, ...] = ()
    elements: tuple[ElementStatus, ...] = ()
