"""What a `location` names: a server, a file, or files with numbers or times in their names."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import unquote, urlsplit

URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
# NAME:PASSWORD@HOST, HOST.DOMAIN:PORT, or localhost:PORT.
BARE_ADDRESS = re.compile(r"(?:[^/@:]+:\S*@[\w.-]+(?::\d+)?|(?:localhost|[\w-]+(?:\.[\w-]+)+):\d+)(?:/|$)")
NUMBER = re.compile(r"%0?\d*d")
NUMBER_BESIDE_TIME = re.compile(r"%0\d+d")  # `%d` is the day there
TIME = re.compile(r"%[YHM]")
# Endings of files of track records; the bytes of video make none of them.
TRACK_SUFFIXES = (".jsonl", ".txt", ".csv", ".geojson", ".kml", ".cot")
FIELD = re.compile(r"(%0\d+d|%[A-Za-z%])")


def is_network(location: str) -> bool:
    """Whether a location is reached over the network: any URL but `file://`."""
    return URL.match(location) is not None and not location.startswith("file://")


def lacks_protocol(location: str) -> bool:
    """Whether a location is a server's address that does not begin with a protocol, such as rtsp://."""
    return "://" not in location and BARE_ADDRESS.match(location) is not None


def local_path(location: str) -> Path:
    """The file a path or `file://` URL names."""
    if location.startswith("file://"):
        return Path(unquote(urlsplit(location).path))
    return Path(location)


class FileNames:
    """The files of a `location`: one, or several with a number (`%05d`) or time (`%Y%m%dT%H%M%SZ`).

    Args:
        location: path or `file://` URL.
        adds_number: whether to add a number if the name has neither number nor time.

    Attributes:
        has_number: whether the name has a number.
        is_several: whether the name has a number or a time.
    """

    def __init__(self, location: str, *, adds_number: bool = False) -> None:
        path = local_path(location)
        self._has_time = TIME.search(path.name) is not None
        if adds_number and not self._has_time and not NUMBER.search(str(path)):
            path = path.with_name(f"{path.stem}-%05d{path.suffix}")
        self._pattern = str(path)
        self._number = NUMBER_BESIDE_TIME if self._has_time else NUMBER
        count = len(self._number.findall(self._pattern))
        self.has_number = count == 1 and (self._has_time or self._pattern.count("%") == 1)
        self.is_several = self.has_number or self._has_time

    def path(self, number: int, utc_ns: int) -> Path:
        """The path for a number and a time, UTC ns."""
        text = self._pattern
        if self.has_number:
            text = self._number.sub(lambda field: field[0] % number, text)
        if self._has_time:
            text = datetime.fromtimestamp(utc_ns // 10**9, UTC).strftime(text)
        return Path(text)

    def matches(self, path: Path) -> bool:
        """Whether a path may be one of the files."""
        own = Path(self._pattern)
        if not self.is_several:
            return own.resolve() == path.resolve()
        return own.parent.resolve() == path.parent.resolve() and self._match(path.name) is not None

    def existing(self) -> Iterator[tuple[Path, int]]:
        """The existing files, with their numbers; 0 without one."""
        folder = Path(self._pattern).parent
        names = os.listdir(folder) if folder.is_dir() else []
        for name in names:
            if (found := self._match(name)) is not None:
                yield folder / name, int(found["number"]) if self.has_number else 0

    def _match(self, name: str) -> re.Match[str] | None:
        pieces = FIELD.split(Path(self._pattern).name)
        pattern = "".join(map(self._expression, pieces))
        return re.fullmatch(pattern, name)

    def _expression(self, piece: str) -> str:
        if self.has_number and self._number.fullmatch(piece):
            return r"(?P<number>\d+)"
        return ".+" if self._has_time and FIELD.fullmatch(piece) else re.escape(piece)
