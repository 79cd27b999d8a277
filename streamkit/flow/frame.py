"""Frame: one item on a pad."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import msgspec

if TYPE_CHECKING:
    from streamkit.flow.caps import Caps

Item = TypeVar("Item")
NO_METADATA: Mapping[type, object] = MappingProxyType({})


class FrameFlags(enum.IntFlag):
    """Marks of a frame."""

    NONE = 0
    DISCONTINUITY = 1
    CORRUPT = 2
    KEYFRAME = 4


class Capture(msgspec.Struct, frozen=True):
    """When a frame was captured.

    Attributes:
        utc_ns: nanoseconds since 1970-01-01 UTC.
        origin: where the time is from: RTCP sender reports, MISB telemetry, the file, or arrival here.
    """

    utc_ns: int
    origin: Literal["rtcp", "misb", "file", "arrival"]


class Frame(msgspec.Struct, frozen=True, eq=False, gc=True):
    """One item on a pad: a picture, a coded packet, telemetry or tracks, told apart by its caps.

    Attributes:
        data: a read-only array for raw video, bytes-like for packets and lines.
        caps: the fixed format of `data`.
        pts: presentation time, ns, monotonic within an epoch; None if unknown.
        duration: ns; None if unknown.
        epoch: goes up at each discontinuity such as a reconnect.
        seq: number given by the source, never reused.
        arrival_ns: monotonic clock when the frame entered the pipeline.
        capture: UTC time of capture with its origin; None if unknown.
        flags: discontinuity, corrupt, keyframe.
        metadata: what elements learnt about the frame, by type.
    """

    data: Any
    caps: Caps
    pts: int | None = None
    duration: int | None = None
    epoch: int = 0
    seq: int = 0
    arrival_ns: int = 0
    capture: Capture | None = None
    flags: int = 0
    metadata: Mapping[type, object] = NO_METADATA

    def __post_init__(self) -> None:
        """Makes the array read-only: whoever shares a frame can trust it."""
        data = self.data
        if data.__class__ is bytes:
            return
        flags = getattr(data, "flags", None)
        if flags is not None:
            flags.writeable = False

    def replace(self, **changes: Any) -> Frame:
        """The same frame with these attributes changed."""
        return msgspec.structs.replace(self, **changes)

    def get(self, kind: Callable[..., Item]) -> Item | None:
        """The metadata of a type, which may be a protocol, or None."""
        return cast("Item | None", self.metadata.get(cast("type", kind)))

    def attach(self, *items: object) -> Frame:
        """The same frame with metadata added, each item under its own type."""
        added = dict(self.metadata)
        for item in items:
            added[type(item)] = item
        return msgspec.structs.replace(self, metadata=added)

    def attach_as(self, kind: type, item: object) -> Frame:
        """The same frame with an item added under a given type, for example a protocol."""
        return msgspec.structs.replace(self, metadata={**self.metadata, kind: item})

    def writable(self) -> Frame:
        """The same frame with a copy of its array, which may be written."""
        frame = msgspec.structs.replace(self, data=self.data.copy())
        frame.data.flags.writeable = True
        return frame

    def describe(self) -> str:
        """A few words that name the frame in a message."""
        time = f" pts={self.pts / 1e9:.3f} s" if self.pts is not None else ""
        epoch = f" epoch={self.epoch}" if self.epoch else ""
        return f"frame seq={self.seq}{time}{epoch}"
