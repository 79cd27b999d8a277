"""Containers: FFmpeg's formats by the endings of files, and the codecs that they hold."""

from __future__ import annotations

import io
from functools import cache
from typing import NamedTuple

import av

# The last two keep the time of a first frame that is later than 0.
FRAGMENTED = {
    "movflags": "frag_keyframe+empty_moov+default_base_moof+frag_discont",
    "frag_duration": "500000",
    "use_editlist": "0",
}
# FFmpeg writes any other codec to a transport stream as data that nothing plays.
TRANSPORT_CODECS = frozenset(
    {"h264", "hevc", "vvc", "mpeg4", "mpeg2video", "mpeg1video", "vc1", "cavs", "dirac"}
)
NOT_IN_MOV = frozenset({"av1", "vp8", "vp9"})  # FFmpeg refuses them with the first packet


class ContainerFormat(NamedTuple):
    """FFmpeg's name of a container, and its options."""

    name: str
    options: dict[str, str] = {}  # noqa: RUF012 - read only

    @property
    def is_transport_stream(self) -> bool:
        """Whether it is made of packets that need no head before them, and may hold telemetry."""
        return self.name in ("mpegts", "hls")

    @property
    def is_mp4(self) -> bool:
        """Whether it is of the family of MP4, which holds times in 32 bits."""
        return self.name in ("mp4", "mov")

    @property
    def takes_negative_times(self) -> bool:
        """Whether decoding times may be below 0, as reordered frames begin with."""
        return "negative_cts_offsets" in self.options.get("movflags", "")

    def holds(self, codec: str) -> bool:
        """Whether it holds a codec, by FFmpeg's name."""
        if self.is_transport_stream:
            return codec in TRANSPORT_CODECS
        return codec in supported_codecs(self.name) and not (self.name == "mov" and codec in NOT_IN_MOV)


FORMATS = {
    ".mp4": ContainerFormat("mp4", FRAGMENTED),
    ".mov": ContainerFormat("mov", FRAGMENTED),
    ".mkv": ContainerFormat("matroska", {"cluster_time_limit": "500"}),
    ".ts": ContainerFormat("mpegts"),
    ".mts": ContainerFormat("mpegts"),
    ".m2ts": ContainerFormat("mpegts", {"mpegts_m2ts_mode": "1"}),
}
PLAYLIST_FORMAT = ContainerFormat("hls")


@cache
def supported_codecs(name: str) -> frozenset[str]:
    """The codecs that FFmpeg's container of a name holds."""
    with av.open(io.BytesIO(), "w", format=name) as container:
        return frozenset(container.supported_codecs)


def check_codec(codec: str, container: ContainerFormat) -> None:
    """Checks that a container holds a codec.

    Raises:
        ValueError: it does not; with what does.
    """
    if not container.holds(codec):
        others = [suffix for suffix, other in FORMATS.items() if other.holds(codec)]
        remedy = f"write {' or '.join(others)}, or encode" if others else "encode"
        raise ValueError(f"{container.name} holds no {codec}; {remedy} to h264, h265 or mpeg4")
