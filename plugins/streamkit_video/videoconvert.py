"""videoconvert: converts raw video to another pixel format."""

from __future__ import annotations

from typing_extensions import override

from streamkit import Caps, Frame, NotNegotiated, Structure, Transform, ValueList
from streamkit_video.pixel_formats import (
    ANY_FORMAT,
    FORMATS,
    by_preference,
    convert,
    odd_size_error,
    supports_size,
)


class VideoConvert(Transform):
    """Converts raw video between pixel formats; frames of the wanted format pass unchanged.

    GRAY8 out of I420 or NV12 is the luma plane, without a copy and without a change of its range.

    Example:
        videotestsrc num-buffers=5 ! videoconvert ! video/x-raw, format=RGB ! fakesink
    """

    sink = src = ANY_FORMAT

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """The same caps in every format; those of `caps` come first, then the cheapest to convert to."""
        if caps.is_any:
            return Caps(ANY_FORMAT)
        structures = []
        for structure in caps.structures:
            if structure.name == "video/x-raw":
                known = formats_in(Caps([structure])) or list(FORMATS)
                order = dict.fromkeys([*known, *by_preference(known[0])])
                fields = {**structure.fields, "format": ValueList(tuple(order))}
                structures.append(Structure(structure.name, fields, structure.features))
        return Caps(structures)

    @override
    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        """The sink's format if allowed, else the cheapest that keeps the colours."""
        same = allowed & sink_caps
        if not same.is_empty:
            return same.fixate()
        return choose_format(allowed, sink_caps, self.name, by_preference(str(sink_caps["format"])))

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._source, self._target = str(sink_caps["format"]), str(src_caps["format"])
        size = (sink_caps.integer("width"), sink_caps.integer("height"))
        for name in (self._source, self._target):
            if self._source != self._target and not supports_size(name, *size):
                raise NotNegotiated(f"{self.name}: {odd_size_error(name, *size)}")

    @override
    def transform(self, frame: Frame) -> Frame:
        if self._source == self._target:
            return frame
        return frame.replace(data=convert(frame.data, self._source, self._target), caps=self.src_caps)


def formats_in(caps: Caps) -> list[str]:
    """The pixel formats of caps, in their order."""
    found: list[str] = []
    for structure in caps.structures:
        value = structure.fields.get("format")
        items = value.items if isinstance(value, ValueList) else (value,)
        found.extend(item for item in items if isinstance(item, str) and item not in found)
    return found


def choose_format(allowed: Caps, near: Caps, element: str, wanted: tuple[str, ...] = ()) -> Caps:
    """Fixed caps out of `allowed`, of the first wanted format that its size allows.

    Args:
        allowed: raw video caps.
        near: preferred values of the other fields.
        element: name for the error.
        wanted: formats in order of preference; the order of `allowed` if empty.

    Raises:
        NotNegotiated: only I420 or NV12 of an odd size is left.
    """
    refused = ""
    for name in wanted or formats_in(allowed):
        caps = (allowed & Caps(f"video/x-raw, format={name}")).fixate(near=near)
        if caps.is_empty:
            continue
        size = (caps.integer("width"), caps.integer("height"))
        if supports_size(name, *size):
            return caps
        refused = refused or odd_size_error(name, *size)
    raise NotNegotiated(f"{element}: {refused or f'caps {allowed} name no format of raw video it knows'}")
