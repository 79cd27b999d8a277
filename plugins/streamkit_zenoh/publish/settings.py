"""PublicationSettings: what zenohsink publishes, its properties, and zenoh's quality of service in words."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import zenoh

from streamkit.settings import setting
from streamkit_zenoh.keys import FRAME, MOSAIC, STATUS, TRACK, TRACKS, VIDEO
from streamkit_zenoh.presence import EXCLUSIVE, SHARED, TAKEOVER
from streamkit_zenoh.wire.encodings import Encoding
from streamkit_zenoh.wire.images import ImageFormat

CONGESTION = {"block": zenoh.CongestionControl.BLOCK, "drop": zenoh.CongestionControl.DROP}
PRIORITIES = {
    "real-time": zenoh.Priority.REAL_TIME,
    "interactive-high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive-low": zenoh.Priority.INTERACTIVE_LOW,
    "data-high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data-low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}
EXPRESS = "express"
# Field and value of each word.
WORDS: dict[str, tuple[str, object]] = {
    **{word: ("congestion_control", value) for word, value in CONGESTION.items()},
    **{word: ("priority", value) for word, value in PRIORITIES.items()},
    EXPRESS: ("express", True),
}


class InvalidQos(ValueError):
    """A text is not a quality of service."""


class Qos(NamedTuple):
    """Quality of service of one stream, with the names of zenoh's arguments.

    Attributes:
        congestion_control: whether a full zenoh queue blocks the publisher or drops the message.
        priority: the zenoh queue.
        express: whether messages are sent at once instead of in batches.
    """

    congestion_control: zenoh.CongestionControl = zenoh.CongestionControl.BLOCK
    priority: zenoh.Priority = zenoh.Priority.DATA
    express: bool = False


def parse_qos(text: str) -> Qos:
    """Parses `block,data-high,express`: words in any order, by default block and data.

    Raises:
        InvalidQos: a word is unknown, or there are two of one kind.
    """
    found: dict[str, Any] = {}
    for word in filter(None, map(str.strip, text.split(","))):
        field, value = WORDS.get(word, ("", None))
        if not field or field in found:
            raise InvalidQos(
                f"a quality of service is one of {', '.join(CONGESTION)}, one of {', '.join(PRIORITIES)}, "
                f"and {EXPRESS} or not, with commas, got {text!r}; write for example drop,data-low"
            )
        found[field] = value
    return Qos(**found)


@dataclass(frozen=True)
class PublicationSettings:
    """What is published below a key; each field is a property of zenohsink."""

    key: str = setting("streamkit", doc="Where to publish: records go to KEY/tracks, and name KEY as source.")
    shared: bool = setting(
        False, doc="Publish together with others at the key; without it the second publisher is refused."
    )
    takeover: bool = setting(False, doc="Make another publisher at the key end.")
    encoding: Encoding = setting(Encoding.JSON, doc="Encoding of records and status.")
    tracks: bool = setting(True, doc="Publish a record per frame at KEY/tracks.")
    provenance: bool = setting(False, doc="Say in the records how each row was computed.")
    track: bool = setting(
        True, doc="Publish each confirmed target at KEY/track/ID, and delete it when it ends."
    )
    status: bool = setting(True, doc="Publish state, counters and age at KEY/status, once a second.")
    control: bool = setting(
        False, doc="Let queries at KEY/control set live properties of this pipeline's elements."
    )
    frame_rate: float = setting(
        0.0, min=0.0, max=1000.0, unit="/s", doc="Frames published at KEY/frame; 0 publishes none."
    )
    frame_width: int = setting(
        960, min=0, max=16384, unit="px", doc="Wider frames are scaled to this width; 0 never scales."
    )
    frame_format: ImageFormat = setting(ImageFormat.JPEG, doc="Image format at KEY/frame.")
    mosaic_format: ImageFormat = setting(ImageFormat.JPEG, doc="Image format at KEY/mosaic.")
    picture_quality: int = setting(80, min=1, max=100, doc="Quality of JPEG images.")
    max_queue: int = setting(256, min=1, max=100_000, doc="Records that may wait to be sent.")
    patience_s: float = setting(
        0.0,
        min=0.0,
        max=86_400.0,
        unit="s",
        doc="How long a frame may wait for room in the queue before the oldest record is dropped.",
    )
    cut_off_s: float = setting(
        5.0, min=1.0, max=3600.0, unit="s", doc="A receiver that takes nothing for so long is cut off."
    )
    ground_altitude: float | None = setting(
        None, unit="m", doc="Altitude of the ground with the datum of the poses; by default as reported."
    )
    tracks_qos: str = setting(
        "block,data-high",
        doc="Quality of service of KEY/tracks: block or drop, a priority (real-time to background), express.",
    )
    track_qos: str = setting("drop,data", doc="Quality of service of KEY/track/ID, in the same words.")
    frame_qos: str = setting("drop,data-low", doc="Quality of service of KEY/frame, in the same words.")
    mosaic_qos: str = setting("block,background", doc="Quality of service of KEY/mosaic, in the same words.")
    video_qos: str = setting("block,data", doc="Quality of service of KEY/video, in the same words.")
    status_qos: str = setting("block,data-high", doc="Quality of service of KEY/status, in the same words.")

    @property
    def claim(self) -> str:
        """How the key is claimed: exclusive, shared or takeover."""
        return TAKEOVER if self.takeover else SHARED if self.shared else EXCLUSIVE

    def qos(self) -> dict[str, Qos]:
        """Quality of service by stream.

        Raises:
            InvalidQos: one is malformed.
        """
        streams = (TRACKS, TRACK, FRAME, MOSAIC, VIDEO, STATUS)
        return {stream: parse_qos(getattr(self, f"{stream}_qos")) for stream in streams}
