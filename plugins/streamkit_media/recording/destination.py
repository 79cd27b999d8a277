"""Destinations of media other than files: datagrams over UDP, and playlists with segments (HLS)."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from streamkit.output.file import OutputFile
from streamkit_media.udp import PACKET_BYTES, open_sender, target_address

DATAGRAM_BYTES = 7 * PACKET_BYTES  # as many packets as fit into an Ethernet frame
SEND_LIMIT_S = 1.0
FOR_WRITING = 2  # FFmpeg's AVIO_FLAG_WRITE


class Destination:
    """Base of what a container is written to in place of an `OutputFile`; nothing written can be undone.

    Attributes:
        path: of the file that a receiver opens, or the location.
        failure: the first error of a write that FFmpeg may hide.
    """

    failure: OSError | None = None

    def __init__(self, path: Path) -> None:
        self.path = path

    def publish(self) -> None:
        """Nothing is held back."""

    def finish(self) -> None:
        """Releases it."""

    def abandon(self) -> None:
        """Releases it after an error."""
        self.finish()

    discard = abandon


class PlaylistFile:
    """A playlist or segment that FFmpeg writes; it appears once it is complete."""

    def __init__(self, path: Path, fail: Callable[[OSError], object]) -> None:
        self._file, self._fail = OutputFile(path, is_whole=True), fail

    def write(self, data: bytes) -> int:
        """Writes all of the data."""
        try:
            return self._file.write(data)
        except OSError as error:
            self._fail(error)
            return len(data)

    def close(self) -> None:
        """Publishes the file, or removes it where it is damaged."""
        try:
            if self._file.failure is None:
                self._file.finish()
        except OSError as error:
            self._fail(error)
        finally:
            self._file.discard()


class Playlist(Destination):
    """An HLS playlist and its segments, files that FFmpeg opens one after another; each appears whole.

    Args:
        path: of the playlist.
        segment_s: least length of a segment, s; it ends before the next keyframe.
        count: of segments kept; 0 keeps all.
        continues: whether to continue an older playlist.

    Attributes:
        options: of FFmpeg's muxer.
    """

    def __init__(self, path: Path, segment_s: float, count: int, *, continues: bool) -> None:
        super().__init__(path)
        flags = ["independent_segments"]
        if count:
            flags.append("delete_segments")
        if continues and path.is_file():
            flags.append("append_list")
        self.options = {
            "hls_time": f"{segment_s:.3f}",
            "hls_list_size": str(count),
            "hls_flags": "+".join(flags),
            "hls_segment_filename": str(path.with_suffix("")).replace("%", "%%") + "-%05d.ts",
        }

    def open(self, path: str, flags: int, options: object) -> PlaylistFile | BinaryIO:
        """Opens a file for FFmpeg; where that fails, an unused buffer: FFmpeg does not pass errors on."""
        try:
            return PlaylistFile(Path(path), self._fail) if flags & FOR_WRITING else Path(path).open("rb")
        except OSError as error:
            self._fail(error)
            return io.BytesIO()

    def _fail(self, error: OSError) -> None:
        self.failure = self.failure or error


class Datagrams(Destination):
    """Sends a transport stream to udp://HOST:PORT[?localaddr=ADDRESS][&ttl=HOPS], a receiver or a group.

    Nothing is sent twice, and sending waits for no receiver: one may come and go.

    Args:
        location: the URL.
        lose: called with a reason for each datagram that cannot be sent.

    Raises:
        OSError: the host is not known, or no way leads there; with the remedy in its text.
    """

    def __init__(self, location: str, lose: Callable[[str], object]) -> None:
        super().__init__(Path(location))
        self._lose = lose
        self._rest = b""
        self._socket = open_sender(target_address(location))
        self._socket.settimeout(SEND_LIMIT_S)

    def write(self, data: bytes) -> int:
        """Sends what is there of whole packets: FFmpeg writes at the end of each frame."""
        rest = self._rest + data
        while len(rest) >= DATAGRAM_BYTES or (rest and len(rest) % PACKET_BYTES == 0):
            self._send(rest[:DATAGRAM_BYTES])
            rest = rest[DATAGRAM_BYTES:]
        self._rest = rest
        return len(data)

    def _send(self, datagram: bytes) -> None:
        try:
            self._socket.send(datagram)
        except OSError as error:  # such as that nothing receives there yet, or a link that is down
            self._lose(error.strerror or "the network takes nothing")

    def finish(self) -> None:
        """Closes the socket."""
        self._socket.close()
