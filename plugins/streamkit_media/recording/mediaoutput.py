"""Base of packetsink and videofilesink: a location is a file, `-`, udp:// or srt://, or a playlist."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar
from urllib.parse import urlsplit

from typing_extensions import override

from streamkit import SECOND_NS, OutputFileSink, Property, PropertyError, ResourceError, mask_secrets
from streamkit.output.file import OutputFile
from streamkit.output.names import is_network
from streamkit.output.pipe import STANDARD_OUTPUT, ReaderWait, standard_output
from streamkit_media.failures import MEDIA_ERRORS
from streamkit_media.live.endpoint import Reconnect
from streamkit_media.live.srtinput import SRT, check_srt_address
from streamkit_media.recording.destination import Datagrams, Destination, Playlist
from streamkit_media.recording.formats import FORMATS, PLAYLIST_FORMAT, ContainerFormat
from streamkit_media.recording.packetwriter import Output
from streamkit_media.recording.srtstream import SrtStream
from streamkit_media.udp import target_address

SEGMENT_NS = 2 * SECOND_NS
MAX_AHEAD_NS = 2 * SECOND_NS
PLAYLIST = ".m3u8"
PLACES = (
    "location must be a file, - (the standard output), udp://HOST:PORT, srt://HOST:PORT or NAME.m3u8 (HLS)"
)
# Their checks, which raise `ValueError`.
ADDRESSES: dict[str, Callable[[str], object]] = {SRT: check_srt_address, "udp": target_address}
REMEDIES = dict.fromkeys(("rtsp", "rtsps"), "rtspclientsink pushes to an RTSP server")


class MediaOutput(OutputFileSink):
    """Base of sinks that write a container; its format is by the ending of the name, or a transport stream.

    Attributes:
        formats: by ending.
    """

    formats: ClassVar[dict[str, ContainerFormat]] = FORMATS
    suffixes = (*FORMATS, PLAYLIST)
    write_errors = (*MEDIA_ERRORS, OSError)

    reconnect: Reconnect = Property(
        Reconnect.ON_ERROR,
        doc="Over SRT, connect again never, after the loss of a receiver, or always: also where the first is "
        "not there. What comes meanwhile is lost, and counted.",
    )

    _ahead: tuple[int, int] | None = None

    @property
    def is_playlist(self) -> bool:
        """Whether segments and their playlist are written."""
        return self.location.lower().endswith(PLAYLIST)

    @property
    def is_sent(self) -> bool:
        """Whether the location is no file, and receivers may join at any time."""
        return is_network(self.location)

    @property
    def _scheme(self) -> str:
        return urlsplit(self.location).scheme

    @override
    def is_file(self) -> bool:
        return not self.is_sent

    @override
    def can_append(self) -> bool:
        return self.is_playlist

    @override
    def check_properties(self) -> None:
        if not self.is_sent:
            super().check_properties()
            return
        try:
            if self._scheme not in ADDRESSES:
                raise ValueError(REMEDIES.get(self._scheme, PLACES))
            ADDRESSES[self._scheme](self.location)
        except ValueError as error:
            # The location stands last: with a secret at its end, what follows would be masked, too.
            raise PropertyError(f"{self.name}: {error}; got location={mask_secrets(self.location)}") from None

    @override
    def start(self) -> None:
        self._ahead = None
        super().start()
        if self.location == STANDARD_OUTPUT and os.isatty(standard_output()):
            raise ResourceError(
                "location=- is a terminal, which shows no video; write it to a program: ... | ffplay -"
            )
        if self.is_sent:
            with self.reported():
                self._sender().finish()

    def container(self) -> ContainerFormat:
        """The container by the location."""
        if self.is_playlist:
            return PLAYLIST_FORMAT
        return self.formats.get(Path(self.location).suffix.lower(), FORMATS[".ts"])

    def open_output(self, segment_ns: int = 0, count: int = 0) -> Output:
        """Opens the next file, or the playlist or network destination that stands in its place.

        Args:
            segment_ns: length of a playlist's segments; 0 is the usual one.
            count: of segments that are kept; 0 keeps all.
        """
        if self.is_sent:
            return self._sender()
        if not self.is_playlist:
            return self.open_file()
        continues = self.if_exists == "continue"
        return Playlist(self.next_path(), (segment_ns or SEGMENT_NS) / SECOND_NS, count, continues=continues)

    def _sender(self) -> Destination:
        """The sender to the location; it connects with the first bytes."""
        if self._scheme != SRT:
            return Datagrams(self.location, self._lose)
        url = f"{SRT}{self.location[len(SRT) :]}"  # the program knows small letters only
        reader_wait = ReaderWait(self.timeout_s, self.stopping, self.waiting)
        return SrtStream(url, reader_wait, self.reconnect, self._connection_changed, self._lose_bytes)

    def _connection_changed(self, reason: str, delay_s: float) -> None:
        """Warns of a connection that is lost, with the reason; reports the next one, without."""
        self.post_message("connection", state="retrying" if reason else "connected", reason=reason)
        if reason:
            self.results["lost_connections"] += 1
            where = mask_secrets(self.location)
            self.post_warning(
                f"{where}: {reason}; what comes meanwhile is lost; trying again in {delay_s:.1f} s",
                "shortfall",
            )

    def _lose_bytes(self, count: int) -> None:
        self.results["lost_bytes"] += count

    def _lose(self, reason: str) -> None:
        """Counts a datagram that could not be sent, and warns of the first."""
        self.results["lost_datagrams"] += 1
        if self.results["lost_datagrams"] == 1:
            where = mask_secrets(self.location)
            self.post_warning(f"{where}: a datagram could not be sent: {reason}; others like it are counted")

    def check_pace(self, pts: int | None) -> None:
        """Warns once of frames that are sent long before their time, pts in ns."""
        if pts is None or not self.is_sent or self._ahead == (0, 0):
            return
        now = time.monotonic_ns()
        first, began = self._ahead = self._ahead or (pts, now)
        if (pts - first) - (now - began) > MAX_AHEAD_NS:
            self._ahead = 0, 0
            where = mask_secrets(self.location)
            self.post_warning(
                f"{where}: frames are sent faster than they play, too fast for receivers; set sync=true"
            )


def shown_location(output: Output, location: str) -> str:
    """The path of a file, or the location of what has none."""
    return str(output.path) if isinstance(output, OutputFile | Playlist) else mask_secrets(location)
