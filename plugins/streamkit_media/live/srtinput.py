"""A transport stream over SRT, received by the program ffmpeg and demultiplexed by FFmpeg."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from urllib.parse import parse_qsl, urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit import ResourceError, mask_secrets
from streamkit_media.failures import AccessRefused, ConnectionLost
from streamkit_media.ffmpegprogram import FfmpegProgram, srt_program
from streamkit_media.live.liveinput import TransportInput

SRT = "srt"
LISTENING = ("listener", "server")  # FFmpeg's names of the mode
# The stream passes as it comes, byte for byte: FFmpeg's muxer would change its times and lose some streams.
COPY = ("-map", "0", "-c", "copy", "-flush_packets", "1", "-f", "data", "pipe:1")


def is_listener(location: str) -> bool:
    """Whether the sender connects to this machine, and not this machine to the sender."""
    return dict(parse_qsl(urlsplit(location).query)).get("mode") in LISTENING


def check_srt_address(location: str) -> None:
    """Checks that a URL names a port, and a host where one is called; raises `ValueError`."""
    parts = urlsplit(location)
    if not parts.port:
        raise ValueError("the port is missing; write srt://HOST:PORT")
    if not parts.hostname and not is_listener(location):
        raise ValueError("the host is missing; write srt://HOST:PORT, or srt://:PORT?mode=listener to wait")


class SrtInput(TransportInput):
    """Receives over SRT, as caller or as listener, in a child process that ends with the connection.

    Args:
        location: with the options of FFmpeg's srt protocol after its `?`.
        timeout_s, low_latency: see `TransportInput`.
    """

    def __init__(self, location: str, timeout_s: float, *, low_latency: bool) -> None:
        super().__init__(location, timeout_s, low_latency=low_latency)
        self.where = mask_secrets(location.partition("?")[0])  # what follows may be a secret to its end
        self._program: FfmpegProgram | None = None

    @override
    def open(self) -> InputContainer:
        command = (srt_program(), "-loglevel", "error", "-nostdin", "-f", "data", "-i", self.location, *COPY)
        try:
            self._program = FfmpegProgram(command)
        except OSError as error:
            raise ResourceError(
                f"{self.where}: the program ffmpeg does not start: {error.strerror or error}; "
                "check that it runs"
            ) from None
        return super().open()

    @override
    def receive(self) -> bytes:
        assert self._program is not None
        try:
            data = self._program.read(self.timeout_s, self.ended)
        except TimeoutError:
            raise self.silence() from None
        if not data and not self._has_come and not self.ended.is_set():
            raise self._no_connection()
        return data

    @override
    def absence(self) -> str:
        seen = "nobody has sent here" if is_listener(self.location) else "nothing has come"
        return f"{seen}; check the address and passphrase at both ends and the firewall, or allow more time"

    def _no_connection(self) -> ResourceError:
        """Why the program has ended before anything came, by its own words."""
        assert self._program is not None
        if self._program.is_refused():
            return AccessRefused(
                f"{self.where}: the other side refuses the passphrase; write the one it has: ?passphrase=..."
            )
        reason = self._program.reason() or "the other side has closed the connection"
        return ResourceError(
            f"{self.where}: no connection: {reason}; check the address, the passphrase, and that the other "
            "side runs"
        )

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        yield from super().packets(container, streams)
        if not self.ended.is_set():
            raise ConnectionLost(
                f"{self.where}: the other side has closed the connection; check that it still runs"
            )

    @override
    def cut(self) -> None:
        is_first = not self.ended.is_set()
        super().cut()
        if is_first and self._program is not None:
            self._program.terminate()

    @override
    def close(self) -> None:
        if self._program is not None:
            self._program.close()
