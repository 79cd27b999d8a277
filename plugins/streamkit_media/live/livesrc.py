"""livesrc: live video over UDP, SRT, TCP, RTMP or HTTP, or from a camera of this machine."""

from __future__ import annotations

from collections import Counter
from urllib.parse import SplitResult, urlsplit

from typing_extensions import override

from streamkit import Caps, Direction, PadTemplate, Presence, Property, ResourceError
from streamkit.output.names import is_network, lacks_protocol
from streamkit_media.failures import ConnectionLost, Silence
from streamkit_media.ffmpegprogram import srt_program
from streamkit_media.live.camerainput import SCHEME, CameraInput, camera_device, camera_options
from streamkit_media.live.datagraminput import DatagramInput
from streamkit_media.live.liveinput import LiveInput, UrlInput
from streamkit_media.live.livesource import VIDEO_PAD, LiveSource
from streamkit_media.live.reachability import LIVE_SCHEMES, port_of
from streamkit_media.live.srtinput import SRT, SrtInput, check_srt_address, is_listener
from streamkit_media.streams import KLV_CAPS
from streamkit_media.udp import source_address

UDP = "udp"
# What a server sends must not make FFmpeg open files.
PROTOCOLS = "tcp,tls,http,https,httpproxy,crypto,data,rtmp,rtmps,rtmpt,rtmpts,rtmpe,ffrtmphttp,ffrtmpcrypt"
REMEDIES = {
    "rtsp": "rtspsrc receives RTSP; write rtspsrc location=rtsp://host:port/path",
    "rtsps": "rtspsrc receives RTSP; write rtspsrc location=rtsps://host:port/path",
    "rtp": "MPEG-TS in RTP is recognised by itself; write uri=udp://@:PORT",
}
FILE = "filesrc reads files; write filesrc location=FILE"
NO_PROTOCOL = (
    "an address must begin with its protocol; write uri=http://camera/video.mjpg, or for rtsp:// "
    "rtspsrc location=rtsp://host:port/path"
)


class LiveSrc(LiveSource):
    """Receives live video from anything but RTSP as coded packets, by the rules of `rtspsrc`.

    `udp://[@]HOST:PORT[?localaddr=ADDRESS]` is MPEG-TS, bare or in RTP, from one sender or a multicast group;
    no HOST is every interface. `srt://HOST:PORT[?passphrase=...&streamid=...]` calls a sender, and
    `srt://:PORT?mode=listener` waits for one; a program ffmpeg of this machine receives it. FFmpeg opens
    `tcp://`, `rtmp://`, `rtmps://`, `http://` and `https://`; a playlist (HLS) is played in real time.
    `v4l2:///dev/video0`, `/dev/video0` or `0` is a camera of this machine;
    `?video_size=1280x720&framerate=30&input_format=mjpeg` chooses what it gives. Reconnects, epochs,
    drops, the message `connection` and the pads of telemetry are those of `rtspsrc`.

    Example:
        livesrc uri=udp://@239.1.2.3:5000 ! decode ! fakesink
    """

    schemes = (*LIVE_SCHEMES, "http", "https")
    uri_schemes = (*LIVE_SCHEMES, SCHEME)
    example = "uri=udp://@:5000"
    templates = (
        VIDEO_PAD,
        *(PadTemplate(name, Direction.SRC, Caps(KLV_CAPS), Presence.SOMETIMES) for name in ("klv", "klv_1")),
    )

    location: str = Property(
        "", name="uri", aliases=("location",), doc="URL of the stream; passwords are never shown."
    )
    lost: int = Property(
        0, read=lambda source: source._counts["lost"], doc="Datagrams missing in the sequence numbers of RTP."
    )
    overflowed: int = Property(
        0,
        read=lambda source: source._counts["overflowed"],
        doc="Datagrams that came faster than they were read.",
    )
    refused: int = Property(
        0,
        read=lambda source: source._counts["refused"],
        doc="Datagrams that were no MPEG-TS, late or repeated.",
    )

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._counts = Counter[str]()
        self._datagrams: DatagramInput | None = None  # the last one

    @override
    def stop(self) -> None:
        super().stop()
        if self._datagrams is not None:
            self._datagrams.leave()
        if lost := self._counts["lost"]:
            self.post_warning(f"{self._where}: {lost} datagrams were lost on their way here")

    @override
    def check_address(self, parts: SplitResult) -> None:
        try:
            if camera_device(self.location):
                camera_options(self.location)
            elif parts.scheme == UDP:
                source_address(self.location)
            elif parts.scheme == SRT:
                check_srt_address(self.location)
                srt_program()
            elif parts.scheme in REMEDIES:
                raise ValueError(REMEDIES[parts.scheme])
            elif self.location and not is_network(self.location):
                raise ValueError(NO_PROTOCOL if lacks_protocol(self.location) else FILE)
            else:
                super().check_address(parts)
                if not port_of(self.location):
                    raise ValueError("the port is missing; write uri=tcp://host:port")
        except ValueError as error:
            raise ResourceError(f"{self._where!r}: {error}") from None

    @property
    @override
    def carrier(self) -> str:
        return SCHEME if camera_device(self.location) else urlsplit(self.location).scheme

    @override
    def make_input(self) -> LiveInput:
        if self.carrier == UDP:
            self._datagrams = DatagramInput(
                self.location,
                self.timeout_s,
                self._counts,
                self.post_warning,
                is_first=self._epoch < 0 and not self._delay.tries,
                low_latency=self.low_latency,
                before=self._datagrams,
            )
            return self._datagrams
        if self.carrier == SRT:
            return SrtInput(self._url, self.timeout_s, low_latency=self.low_latency)
        if self.carrier == SCHEME:
            return CameraInput(self.location, self.timeout_s)
        return UrlInput(self._url, {**self._tls_options, "protocol_whitelist": PROTOCOLS}, self.timeout_s)

    @override
    def listens(self, failure: ResourceError | None) -> bool:
        waits = self.carrier == UDP or (self.carrier == SRT and is_listener(self.location))
        return waits and isinstance(failure, Silence | ConnectionLost)
