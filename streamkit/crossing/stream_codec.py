"""Frames and events of one link as messages: pixels go through shared memory, the rest is in the message."""

from __future__ import annotations

import enum
import os
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, get_args

import msgspec

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import ArrayPlace, NewSlot, SlotReader, SlotWriter
from streamkit.crossing.values import CannotCross, ValueDecoder, ValueEncoder, type_path
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, Event, Segment, SegmentEvent
from streamkit.flow.frame import NO_METADATA, Capture, Frame

EVENTS: dict[str, type[Event]] = {kind.__name__: kind for kind in get_args(Event)}


class LinkMessage(enum.IntEnum):
    """Kinds of messages of a link, from the writer to the reader."""

    FRAME = 0
    EVENT = 1
    SLOT = 2  # a new slot, with its descriptor


class EncodedFrame(NamedTuple):
    """The fields of a frame's message after its kind, as msgspec reads them.

    Attributes:
        capture: time and origin, or None.
        caps: as text where they are others than those of the last frame, else None.
        data: True and the place of an array, or False and an encoded value.
        metadata: for each item its type, and its value unless it is the very item of the last frame.
    """

    pts: Any
    duration: Any
    epoch: int
    seq: int
    arrival_ns: int
    capture: Any
    flags: int
    caps: str | None
    data: Any
    metadata: Any


class StreamEncoder:
    """The writer's side of a link; a new one for each reader, which knows nothing yet."""

    def __init__(self) -> None:
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
        data, made = self._data(frame.data)
        if made is not None:
            try:
                message = self._encoder.encode((LinkMessage.SLOT, made.number, made.size, made.forgotten))
                if not channel.send(message, (made.descriptor,), is_cancelled):
                    return False
            finally:
                os.close(made.descriptor)
        message = self._encoder.encode((LinkMessage.FRAME, *self._frame(frame, data)))
        return channel.send(message, (), is_cancelled)

    def event(self, event: Event, begin_ns: int) -> bytes:
        """The message of an event; with new caps goes what `query_begin_ns` returns upstream."""
        fields: list[Any]
        if isinstance(event, CapsEvent):
            self._caps, fields = event.caps, [str(event.caps), begin_ns]
        else:
            value = event.segment if isinstance(event, SegmentEvent) else event
            fields = [getattr(value, name) for name in value.__dataclass_fields__]
        return self._encoder.encode((LinkMessage.EVENT, type(event).__name__, fields))

    def _frame(self, frame: Frame, data: Any) -> EncodedFrame:
        caps = None
        if frame.caps is not self._caps:
            self._caps, caps = frame.caps, str(frame.caps)
        metadata, self._last = self._metadata(frame), dict(frame.metadata)
        capture = frame.capture and (frame.capture.utc_ns, frame.capture.origin)
        return EncodedFrame(
            frame.pts, frame.duration, frame.epoch, frame.seq, frame.arrival_ns, capture, int(frame.flags),
            caps, data, metadata,
        )  # fmt: skip

    def _data(self, data: Any) -> tuple[Any, NewSlot | None]:
        """The place of an array, or the encoded value of other data."""
        if hasattr(type(data), "__array_interface__") and data.ndim:  # an array's own makes a dict
            place, made = self.slots.write(data)
            return [True, *place], made
        try:
            return [False, self._values.encode(data)], None
        except CannotCross as error:
            try:
                return [False, bytes(memoryview(data))], None  # such as a packet of a codec library
            except TypeError:
                raise error from None

    def _metadata(self, frame: Frame) -> list[Any]:
        last, encode = self._last, self._values.encode
        return [
            (type_path(kind),) if item is last.get(kind) else (type_path(kind), encode(item))
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
        self._decoder = msgspec.msgpack.Decoder()
        self._encoder = msgspec.msgpack.Encoder()
        self._caps: Caps | None = None
        self._last: dict[str, tuple[type, object]] = {}

    def decode(self, message: bytes, channel: Channel) -> Frame | Event | None:
        """The frame or event of a message; None for one that only announces shared memory.

        Raises:
            ValueError: the message is none of these.
        """
        try:
            kind, *fields = self._decoder.decode(message)
            if kind == LinkMessage.FRAME:
                return self._frame(EncodedFrame(*fields))
            if kind == LinkMessage.SLOT:
                number, size, forgotten = fields
                self.slots.add(NewSlot(int(number), int(size), tuple(forgotten), channel.take_descriptor()))
                return None
            return self._event(*fields)
        except (TypeError, LookupError, msgspec.DecodeError) as error:
            raise ValueError(f"the other process has sent something unreadable: {error}") from error

    def taken(self) -> bytes:
        """The answer once the elements downstream have taken a frame: the numbers of the slots now free."""
        released, slots = [], self.slots.released
        while slots:
            released.append(slots.popleft())
        return self._encoder.encode(released)

    def _event(self, name: str, fields: list[Any]) -> Event:
        kind = EVENTS[name]
        if kind is CapsEvent:
            self._caps, self.begin_ns = Caps(fields[0]), int(fields[1])
            return CapsEvent(self._caps)
        return SegmentEvent(Segment(*fields)) if kind is SegmentEvent else kind(*fields)

    def _frame(self, encoded: EncodedFrame) -> Frame:
        if encoded.caps is not None:
            self._caps = Caps(encoded.caps)
        if self._caps is None:
            raise ValueError("the other process has sent a frame before its caps")
        decode = self._values.decode
        is_array, *content = encoded.data
        data = self._array(*content) if is_array else decode(*content)
        capture = Capture(*encoded.capture) if encoded.capture else None
        return Frame(
            data, self._caps, decode(encoded.pts), decode(encoded.duration), encoded.epoch, encoded.seq,
            encoded.arrival_ns, capture, encoded.flags, self._metadata(encoded.metadata) or NO_METADATA,
        )  # fmt: skip

    def _array(self, slot: Any, dtype: Any, shape: list[int], strides: list[int]) -> Any:
        return self.slots.read(ArrayPlace(slot, dtype, tuple(shape), tuple(strides)))

    def _metadata(self, items: list[list[Any]]) -> dict[type, object]:
        last, self._last = self._last, {}
        for path, *encoded in items:
            if encoded:
                self._last[path] = self._values.find_type(path), self._values.decode(encoded[0])
            else:
                self._last[path] = last[path]
        return dict(self._last.values())


def read_released(message: bytes) -> list[int]:
    """The numbers of `StreamDecoder.taken`; raises `ValueError` for another message."""
    try:
        return msgspec.msgpack.decode(message, type=list[int])
    except msgspec.DecodeError as error:
        raise ValueError(f"the reading process has sent something unreadable: {error}") from error
