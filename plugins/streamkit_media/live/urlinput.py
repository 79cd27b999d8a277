"""A connection that FFmpeg makes over TCP: bounded, cut from outside, its failures explained."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import ResourceError, mask_secrets
from streamkit_media.container import AccessRefused, open_container
from streamkit_media.live.liveinput import ConnectionLost
from streamkit_media.live.pacing import paced
from streamkit_media.live.reachability import port_of, unreachable
from streamkit_media.live.sockets import CLAIMS, cut_connections, is_closed_by_peer, open_sockets
from streamkit_media.packets import read_packets

# FFmpeg would otherwise read up to five seconds to guess the frame rate.
LIVE_OPTIONS = {"analyzeduration": "1500000", "fpsprobesize": "0"}
PLAYLIST = "hls"
ONE_CLIENT = ("tcp", "rtmp")  # a simple sender takes one client: a look at the port would take its place


class UrlInput:
    """A connection to a server; see `LiveInput`.

    Args:
        location: URL of the stream.
        options: FFmpeg options for it besides `LIVE_OPTIONS`.
        timeout_s: limit for opening and for each read.
    """

    def __init__(self, location: str, options: Mapping[str, str], timeout_s: float) -> None:
        self.location, self.timeout_s = location, timeout_s
        self.options = {**LIVE_OPTIONS, **options}
        self.sockets: frozenset[str] = frozenset()
        self._known = frozenset(open_sockets())
        self._ended = threading.Event()

    def open(self) -> InputContainer:
        """Connects.

        Raises:
            ResourceError: refused, silent or not to be trusted; the text says which.
        """
        began = time.monotonic()
        try:
            return self.opened(self.options)
        except AccessRefused:
            raise
        except ResourceError as error:
            serves_one_client = urlsplit(self.location).scheme in ONE_CLIENT
            left_s = self.timeout_s - (time.monotonic() - began)
            if left_s <= 0 or self._ended.is_set() or serves_one_client:
                raise
            # FFmpeg often does not say why.
            reason = unreachable(self.location, self.options.get("ca_file"), left_s, "check the address")
            raise ResourceError(f"{mask_secrets(self.location)}: {reason}") if reason else error from None

    def opened(self, options: Mapping[str, str]) -> InputContainer:
        """Connects with these options, and notes the connection's sockets."""
        if self._ended.is_set():
            raise ResourceError(f"{mask_secrets(self.location)}: the connection was ended from here")
        container = open_container(self.location, options, (self.timeout_s, self.timeout_s))
        self.sockets = CLAIMS.claim(self, port_of(self.location), self._known)
        return container

    def packets(
        self, container: InputContainer, streams: Sequence[Stream], left_s: Callable[[], float]
    ) -> Iterator[Packet[Stream]]:
        """The packets until the stream ends; raises `ConnectionLost` where the server closes it amid."""
        packets = read_packets(container, *streams)
        if container.format.name == PLAYLIST:  # which says itself where the stream ends
            yield from paced(packets, self._ended)
            return
        yield from packets
        self.check_end()

    def check_end(self) -> None:
        """Raises `ConnectionLost` where the stream has ended because the server has closed the connection."""
        if is_closed_by_peer(self.sockets):
            where = mask_secrets(self.location)
            raise ConnectionLost(f"{where}: the server has closed the connection; check that it still runs")

    def cut(self) -> None:
        """Shuts down the connection, also while it is being made."""
        self._ended.set()
        cut_connections(port_of(self.location), self._known | CLAIMS.of_others(self))

    def close(self) -> None:
        """Gives up the claim to the sockets, which the container has closed."""
        CLAIMS.release(self)
