"""videoconvert: raw video in another pixel format."""

from __future__ import annotations

from streamkit import Caps, Frame, NotNegotiated, Structure, Transform, ValueList
from streamkit_video.pixel_formats import FORMATS, by_preference, convert, odd_size, size_allows
from streamkit_video.raw_caps import choose_format, formats_in

ANY_FORMAT = f"video/x-raw, format={{ {', '.join(FORMATS)} }}"


class VideoConvert(Transform):
    """Converts raw video between pixel formats; frames of the format wanted pass untouched.

    GRAY8 out of I420 or NV12 is the luma plane as it stands, without copy and without stretching its range.

    Example:
        videotestsrc num-buffers=5 ! videoconvert ! video/x-raw, format=RGB ! fakesink
    """

    sink = src = ANY_FORMAT

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """The same caps in every format; those of `caps` come first, then what is cheapest from them."""
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

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        """The sink's own format if allowed, else the cheapest that keeps the colours."""
        source = str(sink_caps["format"])
        same = allowed & sink_caps
        if not same.is_empty:
            return same.fixate()
        return choose_format(allowed, by_preference(source), sink_caps, self.name)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """Remembers the formats; refuses sizes that one of them cannot have."""
        self._source, self._target = str(sink_caps["format"]), str(src_caps["format"])
        size = (sink_caps.integer("width"), sink_caps.integer("height"))
        for name in (self._source, self._target):
            if self._source != self._target and not size_allows(name, *size):
                raise NotNegotiated(f"{self.name}: {odd_size(name, *size)}")

    def transform(self, frame: Frame) -> Frame:
        """The frame in the format agreed."""
        if self._source == self._target:
            return frame
        return frame.replace(data=convert(frame.data, self._source, self._target), caps=self.src_caps)
