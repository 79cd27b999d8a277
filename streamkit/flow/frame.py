"""Frame: one item on a pad."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeVar, cast

import msgspec

from streamkit.flow.caps import Caps
from streamkit.flow.metadata import Registration, Tracks
from streamkit.geometry.track import Track

Item = TypeVar("Item")
NO_METADATA: Mapping[type, object] = MappingProxyType({})
SHARED = frozenset({"builtins", "numpy"})  # modules whose types anybody may attach


class FrameFlags(enum.IntFlag):
    """Flags of a frame."""

    NONE = 0
    DISCONTINUITY = 1
    CORRUPT = 2
    KEYFRAME = 4


class Capture(msgspec.Struct, frozen=True):
    """When a frame was captured.

    Attributes:
        utc_ns: nanoseconds since 1970-01-01 UTC.
        origin: RTCP sender reports, MISB telemetry, the file, or arrival here.
    """

    utc_ns: int
    origin: Literal["rtcp", "misb", "file", "arrival"]


class Frame(msgspec.Struct, frozen=True, eq=False, gc=True):
    """One item on a pad: video, a coded packet, telemetry or tracks, as its caps say.

    Attributes:
        data: read-only array for raw video, bytes-like for packets and text.
        caps: the fixed format of `data`.
        pts: presentation time, ns, monotonic within an epoch; None if unknown.
        duration: ns; None if unknown.
        epoch: increases at each discontinuity such as a reconnect.
        seq: sequence number from the source, never reused.
        arrival_ns: monotonic clock when the frame entered the pipeline.
        capture: UTC time of capture with its origin; None if unknown.
        flags: combination of `FrameFlags`.
        metadata: results of elements, by type.
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
        """Makes the array read-only, because frames are shared."""
        data = self.data
        if data.__class__ is bytes:
            return
        flags = getattr(data, "flags", None)
        if flags is not None:
            flags.writeable = False

    def __reduce__(self) -> tuple[type[Frame], tuple[object, ...]]:
        """Allows copies and pickling, for which the metadata must be a plain dict."""
        metadata = dict(self.metadata)
        return Frame, (
            *(getattr(self, name) for name in self.__struct_fields__ if name != "metadata"),
            metadata,
        )

    def __repr__(self) -> str:
        """One line for notebooks and errors, without pixels and metadata."""
        kinds = ", ".join(kind.__name__ for kind in self.metadata)
        return f"<{self.describe()}: {self.caps}{'; ' if kinds else ''}{kinds}>"

    def replace(self, **changes: Any) -> Frame:
        """A copy with these attributes changed; data is shared.

        Raises:
            TypeError: there is no such attribute, or metadata is no mapping: `attach` adds to it.
        """
        if "metadata" in changes and not isinstance(changes["metadata"], Mapping):
            given = type(changes["metadata"]).__name__
            raise TypeError(f"metadata= must be a mapping by type, got {given}; add it by frame.attach(...)")
        return msgspec.structs.replace(self, **changes)

    def get(self, kind: Callable[..., Item]) -> Item | None:
        """Metadata of a type, which may be a protocol, or None."""
        return cast("Item | None", self.metadata.get(cast("type", kind)))

    @property
    def tracks(self) -> tuple[Track, ...]:
        """The targets, in order of their ids; empty without a tracker."""
        found = self.get(Tracks)
        return () if found is None else found.tracks

    @property
    def registration(self) -> Registration | None:
        """Its registration; None without a stitcher."""
        return self.get(Registration)

    def attach(self, *items: object) -> Frame:
        """A copy with metadata added, each item under its own type.

        Raises:
            TypeError: an item is of a type that anybody may attach, such as a dict, list, number or array.
        """
        added = dict(self.metadata)
        for item in items:
            if type(item).__module__ in SHARED or isinstance(item, Mapping):
                raise TypeError(
                    "metadata is found by its type, which must be a class of its own, as a dataclass, got "
                    f"{type(item).__name__}"
                )
            added[type(item)] = item
        return msgspec.structs.replace(self, metadata=added)

    def attach_as(self, kind: type, item: object) -> Frame:
        """A copy with metadata added under a given type, for example a protocol."""
        return msgspec.structs.replace(self, metadata={**self.metadata, kind: item})

    def writable(self) -> Frame:
        """A copy with a writable copy of the array."""
        frame = msgspec.structs.replace(self, data=self.data.copy())
        frame.data.flags.writeable = True
        return frame

    def describe(self) -> str:
        """Identifies the frame in messages."""
        is_number = isinstance(self.pts, int | float)  # an element may set anything
        time = f" pts={self.pts / 1e9:.3f} s" if is_number and self.pts is not None else ""
        epoch = f" epoch={self.epoch}" if self.epoch else ""
        return f"frame seq={self.seq}{time}{epoch}"
