"""StreamFormat: units in which GStreamer's sources count; ours count nanoseconds."""

from __future__ import annotations

from streamkit.element.choice import Choice


class StreamFormat(Choice):
    """What positions of a stream are counted in."""

    UNDEFINED = "undefined", 0, "GST_FORMAT_UNDEFINED"
    DEFAULT = "default", 1, "GST_FORMAT_DEFAULT"
    BYTES = "bytes", 2, "GST_FORMAT_BYTES"
    TIME = "time", 3, "GST_FORMAT_TIME"
    BUFFERS = "buffers", 4, "GST_FORMAT_BUFFERS"
    PERCENT = "percent", 5, "GST_FORMAT_PERCENT"
