"""Opening media with FFmpeg: always within a time limit, always with an error that says what to do."""

from __future__ import annotations

import os
import stat
import struct
import time
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote, urlsplit

import av
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from streamkit import ResourceError, StreamError, mask_secrets
from streamkit.errors import did_you_mean
from streamkit.output.names import FileNames, is_network, lacks_protocol, local_path
from streamkit.output.pipe import STANDARD_INPUT
from streamkit_media.failures import MEDIA_ERRORS, open_failure

LOCAL_LIMIT_S = 8.0
MAX_PIXELS = 8192 * 8192
MOST_NAMES = 10_000  # of a folder, in which a similar one is looked for
PIPE_REMEDY = (
    "a pipe is not read; write it to a file first, or send it, as in ... | ffmpeg -i - -c copy -f mpegts "
    "udp://127.0.0.1:5000 with livesrc uri=udp://@:5000"
)
# Formats that read any text as video, or make FFmpeg open other files than the one asked for.
UNWANTED_FORMATS = frozenset({"tty", "bin", "idf", "xbin", "adf", "concat", "lavfi"})

# Only these containers have an orientation.
ROTATING_FORMATS = frozenset({"mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm"})
LOOK_PACKETS = 8


def with_credentials(location: str, user: str, password: str) -> str:
    """The URL with a user name and password in it; one that has its own, or no user, stays as it is."""
    if not user or "@" in urlsplit(location).netloc:
        return location
    scheme, _, rest = location.partition("://")
    return f"{scheme}://{quote(user, safe='')}:{quote(password, safe='')}@{rest}"


class ReadsBytes(Protocol):
    """A file as far as FFmpeg reads it."""

    def read(self, size: int) -> bytes:
        """At most `size` bytes; empty at the end."""


def open_container(
    location: str,
    options: Mapping[str, str] | None = None,
    limits_s: tuple[float, float] = (LOCAL_LIMIT_S, LOCAL_LIMIT_S),
    format_name: str | None = None,
    stream: ReadsBytes | None = None,
) -> InputContainer:
    """Opens a file, URL or stream for reading.

    Args:
        location: path, `file://` URL or any URL FFmpeg reads.
        options: FFmpeg options for the container.
        limits_s: time limits for opening and for each read, s; a generous one by default.
        format_name: FFmpeg's name of the format; detected where None.
        stream: what is received from the location by other means; its `read` has limits of its own, and its
            errors pass.

    Raises:
        ResourceError: missing, not a file, not readable, or not reachable.
        StreamError: it is no media FFmpeg reads.
    """
    chosen = {"max_pixels": str(MAX_PIXELS), **(options or {})}
    file: str | ReadsBytes = stream or location
    if not is_network(location):
        check_file(location)
        file = f"file:{local_path(location)}"
        chosen.setdefault("protocol_whitelist", "file,crypto,data")
    timeout = None if stream else limits_s
    began = time.monotonic()
    try:
        container = av.open(
            file, "r", format=format_name, options=chosen, timeout=timeout, metadata_errors="replace"
        )
    except MEDIA_ERRORS as error:
        is_late = timeout is not None and time.monotonic() - began >= limits_s[0]
        raise open_failure(location, error, limits_s[0] if is_late else None) from None
    if container.format.name in UNWANTED_FORMATS:
        found = container.format.name
        container.close()
        raise StreamError(
            f"{mask_secrets(location)}: a video must be given, this is text or a list ({found})"
        )
    return container


def check_file(location: str) -> None:
    """Checks that a location is a regular file with content.

    Raises:
        ResourceError: it is not there, or not a file that can be read.
        StreamError: it is empty.
    """
    if location == STANDARD_INPUT:
        raise ResourceError(f"{location}: a file is needed, this is the standard input; {PIPE_REMEDY}")
    path = local_path(location)
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode):
            with path.open("rb"):
                pass
    except FileNotFoundError:
        remedy = similar_file(path) or f"check the path (relative ones start at {path.cwd()})"
        if FileNames(location).has_number:
            remedy = "numbered images are read by multifilesrc, with start-index= of the first"
        if lacks_protocol(location):
            remedy += ", or begin the address of a camera with rtsp://"
        raise ResourceError(f"{location}: a file must be there, none is; {remedy}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ResourceError(
            f"{location}: the file cannot be read: {reason}; check the path and its rights"
        ) from None
    if stat.S_ISDIR(status.st_mode):
        raise ResourceError(
            f"{location}: a file is needed, this is a directory; name a file in it; of numbered images, "
            "streamkit doctor DIR/FIRST.jpg gives the multifilesrc that reads all"
        )
    if not stat.S_ISREG(status.st_mode):
        kind = "a pipe, socket or device"
        raise ResourceError(f"{location}: a regular file is needed, this is {kind}; {PIPE_REMEDY}")
    if status.st_size == 0:
        raise StreamError(f"{location}: the file is empty (0 bytes); it may not have been written yet")


def similar_file(path: Path) -> str:
    """A hint with the file of the folder whose name is most like that of a missing one, or ""."""
    try:
        names = [entry.name for entry in islice(os.scandir(path.parent), MOST_NAMES)]
    except OSError:
        return ""
    return did_you_mean(path.name, names, 0.8)


def video_stream(container: InputContainer, location: str, index: int | None = None) -> VideoStream:
    """The video stream of an index; by default the one FFmpeg finds best.

    Raises:
        StreamError: there is none, or no decoder for it.
    """
    videos = {video.index: video for video in container.streams.video}
    stream = container.streams.best("video") if index is None else videos.get(index)
    if index is not None and stream is None:
        numbers = ", ".join(map(str, videos)) or "none"
        raise StreamError(f"{mask_secrets(location)}: stream {index} is no video; videos are {numbers}")
    if stream is None:
        kinds = ", ".join(sorted({other.type for other in container.streams})) or "none"
        raise StreamError(f"{mask_secrets(location)}: a video stream is needed, its streams are: {kinds}")
    if not isinstance(stream, VideoStream) or stream.codec_context is None:
        raise StreamError(
            f"{mask_secrets(location)}: there is a video stream, but this FFmpeg build has no decoder for "
            "it; convert the file to H.264"
        )
    return stream


def other_videos(container: InputContainer, chosen: VideoStream) -> list[int]:
    """The indices of a container's further videos; the picture on a cover is none."""
    return [
        stream.index
        for stream in container.streams.video
        if stream.index != chosen.index and not stream.disposition & Disposition.attached_pic
    ]


def unread_remedy(unread: list[int]) -> str:
    """The rest of a warning that names the video that is read: which others are not, and how to read one."""
    return f"and not {unread}; write video-stream={unread[0]} to read another"


def display_orientation(container: InputContainer, stream: VideoStream) -> dict[str, int | bool]:
    """How a file's video is to be turned for display, as fields of caps; empty where it is not.

    `flipped` is true where it is first turned upside down, as a mirrored picture is; `rotation` is
    counter-clockwise: 90, 180 or 270 degrees. FFmpeg returns them with a decoded frame only, so that packets
    are read up to the first frame.
    """
    if not ROTATING_FORMATS & set(container.format.name.split(",")):
        return {}
    try:
        packets = islice(container.demux(stream), LOOK_PACKETS)
        frame = next((frame for packet in packets for frame in stream.decode(packet)), None)
    except (*MEDIA_ERRORS, OSError):
        return {}  # playing reports what is wrong
    matrix: Any = None if frame is None else frame.side_data.get("DISPLAYMATRIX")
    if frame is None or matrix is None:
        return {}
    a, b, _, c, d = struct.unpack_from("=5i", matrix)
    fields = {"rotation": round(frame.rotation / 90) * 90 % 360, "flipped": a * d < b * c}
    return {name: value for name, value in fields.items() if value}
