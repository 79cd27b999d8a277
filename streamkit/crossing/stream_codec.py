"""Frames and events of one link as messages: pixels go through shared memory, the rest is in the message."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, get_args

import msgspec

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import ArrayPlace, NewSlot, NumberRing, SlotReader, SlotWriter
from streamkit.crossing.values import CannotCross, ValueDecoder, ValueEncoder, type_path
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, Event, Segment, SegmentEvent
from streamkit.flow.frame import NO_METADATA, Capture, Frame

EVENTS: dict[str, type[Event]] = {kind.__name__: kind for kind in get_args(Event)}


class FrameMessage(msgspec.Struct, array_like=True, tag=0):
    """A frame.

    Attributes:
        caps: as text where they are others than those of the last frame, else None.
        place: of an array; None for other data.
        data: the encoded value of other data.
        metadata: for each item its type, and its value unless it is the very item of the last frame.
    """

    pts: Any
    duration: Any
    epoch: int
    seq: int
    arrival_ns: int
    capture: Capture | None
    flags: int
    caps: str | None
    place: ArrayPlace | None
    data: Any
    metadata: list[list[Any]]


class EventMessage(msgspec.Struct, array_like=True, tag=1):
    """An event."""

    name: str
    fields: list[Any]


class StreamEncoder:
    """The writer's side of a link; a new one for each reader, which knows nothing yet.

    Args:
        released: numbers of the slots that the reader no longer uses.
    """

    def __init__(self, released: NumberRing) -> None:
        self._released = released
        self.slots = SlotWriter()
        self._values = ValueEncoder()
        self._encoder = msgspec.msgpack.Encoder()
        self._caps: Caps | None = None
        self._last: dict[type, object] = {}  # metadata of the last frame

    def send_frame(self, frame: Frame, channel: Channel, is_cancelled: Callable[[], bool]) -> bool:
        """Sends a frame, after the slot that it needs; False if that was cancelled.

        Raises:
            CannotCross: the data or metadata has no form for it.
            ChannelClosed: the reader has ended.
        """
        for number in self._released.take():
            self.slots.release(number)
        place, data, made = self._data(frame.data)
        if made is not None:
            try:
                if not channel.send(self._encoder.encode(made), (made.descriptor,), is_cancelled):
                    return False
            finally:
                os.close(made.descriptor)
        return channel.send(self._encoder.encode(self._message(frame, place, data)), (), is_cancelled)

    def event(self, event: Event, begin_ns: int) -> bytes:
        """The message of an event; with new caps goes what `query_begin_ns` returns upstream."""
        fields: list[Any]
        if isinstance(event, CapsEvent):
            self._caps, fields = event.caps, [str(event.caps), begin_ns]
        else:
            value = event.segment if isinstance(event, SegmentEvent) else event
            fields = [getattr(value, name) for name in value.__dataclass_fields__]
        return self._encoder.encode(EventMessage(type(event).__name__, fields))

    def _message(self, frame: Frame, place: ArrayPlace | None, data: Any) -> FrameMessage:
        caps = None
        if frame.caps is not self._caps:
            self._caps, caps = frame.caps, str(frame.caps)
        metadata, self._last = self._metadata(frame), dict(frame.metadata)
        return FrameMessage(
            frame.pts, frame.duration, frame.epoch, frame.seq, frame.arrival_ns, frame.capture,
            int(frame.flags), caps, place, data, metadata,
        )  # fmt: skip

    def _data(self, data: Any) -> tuple[ArrayPlace | None, Any, NewSlot | None]:
        """The place of an array, or the encoded value of other data, and the slot made for it."""
        if hasattr(type(data), "__array_interface__") and data.ndim:  # an array's own makes a dict
            place, made = self.slots.write(data)
            return place, None, made
        try:
            return None, self._values.encode(data), None
        except CannotCross as error:
            try:
                return None, bytes(memoryview(data)), None  # such as a packet of a codec library
            except TypeError:
                raise error from None

    def _metadata(self, frame: Frame) -> list[Any]:
        last, encode = self._last, self._values.encode
        return [
            [type_path(kind)] if item is last.get(kind) else [type_path(kind), encode(item)]
            for kind, item in frame.metadata.items()
        ]


class StreamDecoder:
    """The reader's side of a link.

    Attributes:
        begin_ns: time of the first frame of what the source reads, as it came with the caps, ns.
    """

    def __init__(self, packages: Iterable[str]) -> None:
        self.slots = SlotReader()
        self._values = ValueDecoder(packages)
        self.begin_ns = 0
        self._decoder = msgspec.msgpack.Decoder(FrameMessage | EventMessage | NewSlot)
        self._caps: Caps | None = None
        self._last: dict[str, tuple[type, object]] = {}

    def decode(self, message: bytes, channel: Channel) -> Frame | Event | None:
        """The frame or event of a message; None for one that only announces shared memory.

        Raises:
            ValueError: the message is none of these.
        """
        try:
            read = self._decoder.decode(message)
            if isinstance(read, NewSlot):
                read.descriptor = channel.take_descriptor()
                self.slots.add(read)
                return None
            return (
                self._frame(read) if isinstance(read, FrameMessage) else self._event(read.name, read.fields)
            )
        except (TypeError, LookupError, msgspec.DecodeError) as error:
            raise ValueError(f"the other process has sent something unreadable: {error}") from error

    def _event(self, name: str, fields: list[Any]) -> Event:
        kind = EVENTS[name]
        if kind is CapsEvent:
            self._caps, self.begin_ns = Caps(fields[0]), int(fields[1])
            return CapsEvent(self._caps)
        return SegmentEvent(Segment(*fields)) if kind is SegmentEvent else kind(*fields)

    def _frame(self, message: FrameMessage) -> Frame:
        if message.caps is not None:
            self._caps = Caps(message.caps)
        if self._caps is None:
            raise ValueError("the other process has sent a frame before its caps")
        place = message.place
        data = self._values.decode(message.data) if place is None else self.slots.read(place)
        return Frame(
            data, self._caps, message.pts, message.duration, message.epoch, message.seq, message.arrival_ns,
            message.capture, message.flags, self._metadata(message.metadata) or NO_METADATA,
        )  # fmt: skip

    def _metadata(self, items: list[list[Any]]) -> dict[type, object]:
        last, self._last = self._last, {}
        for path, *encoded in items:
            if encoded:
                self._last[path] = self._values.find_type(path), self._values.decode(encoded[0])
            else:
                self._last[path] = last[path]
        return dict(self._last.values())
