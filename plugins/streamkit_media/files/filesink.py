"""filesink: the bytes of frames to a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from typing_extensions import override

from streamkit import Caps, Frame, OutputFileSink, ResourceError
from streamkit.output.names import TRACK_SUFFIXES

CONTAINERS = frozenset({".mp4", ".mov", ".mkv", ".webm", ".avi"})
IMAGES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
LINE_TYPES = ("text/", "application/json", "application/x-tracks", "application/x-json")


class FileSink(OutputFileSink):
    """Writes each frame's bytes to a file; text and JSON one frame a line.

    Example:
        videotestsrc num-buffers=5 ! filesink location=frames.raw
    """

    sink = "ANY"
    _is_lines = False

    @override
    def start(self) -> None:
        super().start()
        self._check_suffix(self.pads["sink"].peer_caps())

    def configure(self, sink_caps: Caps) -> None:
        """Lines for text, bytes as they are for all else.

        Raises:
            ResourceError: the file's name is that of a container, of track records or, for raw video, of a
                image; the bytes of video make none of them.
        """
        self._check_suffix(sink_caps)
        self._is_lines = sink_caps.name.startswith(LINE_TYPES)

    def _check_suffix(self, caps: Caps) -> None:
        suffix = Path(self.location).suffix.lower()
        media = {structure.name for structure in caps.structures}
        if not media or not all(name.startswith("video/") for name in media):
            return
        sink = "videofilesink" if "video/x-raw" in media else "packetsink"
        check_pixels(caps, self.location, "filesink")
        if suffix in TRACK_SUFFIXES:
            sink = "tracksink"
        if suffix in (*CONTAINERS, *TRACK_SUFFIXES):
            raise ResourceError(
                f"location={self.location}: filesink writes the bytes of frames, which are no {suffix} file; "
                f"write {sink} location={self.location}"
            )

    def can_append(self) -> bool:
        """Bytes follow bytes."""
        return True

    def write(self, frame: Frame) -> None:
        """Writes one frame."""
        assert self.file is not None
        data = as_bytes(frame.data)
        if self._is_lines and bytes(data[-1:]) != b"\n":
            data = bytes(data) + b"\n"
        self.file.append(data)


def check_pixels(caps: Caps, location: str, factory: str) -> None:
    """Checks that raw pixels are not written to files that are named as images.

    Raises:
        ResourceError: raw video is.
    """
    path = Path(location)
    if path.suffix.lower() in IMAGES and any(item.name == "video/x-raw" for item in caps.structures):
        stem = path.stem if "%" in location else f"{path.stem}-%05d"
        raise ResourceError(
            f"location={location}: {factory} writes the bytes of frames, which are no {path.suffix} file; "
            f"write jpegsink location={path.with_name(stem)}.jpg"
        )


def as_bytes(data: Any) -> bytes | memoryview:
    """The bytes of a frame's data: text in UTF-8, arrays row by row, anything else bytes-like as it is."""
    if isinstance(data, str):
        return data.encode()
    view = memoryview(data)
    return view.cast("B") if view.c_contiguous and view.nbytes else view.tobytes()
