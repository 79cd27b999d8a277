"""Values of `location=`: paths and URLs, shown without passwords, and numbered file names."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from streamkit import mask_secrets

URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
NUMBER = re.compile(r"%0?\d*d")


def is_network(location: str) -> bool:
    """Whether a location is reached over the network: any URL but `file://`."""
    return URL.match(location) is not None and not location.startswith("file://")


def local_path(location: str) -> Path:
    """The file a path or `file://` URL names."""
    if location.startswith("file://"):
        return Path(unquote(urlsplit(location).path))
    return Path(location)


def redact(text: str) -> str:
    """The text with secrets masked."""
    return mask_secrets(text)


def with_credentials(location: str, user: str, password: str) -> str:
    """The URL with a user name and password in it; one that has its own, or no user, stays as it is."""
    if not user or "@" in urlsplit(location).netloc:
        return location
    scheme, _, rest = location.partition("://")
    return f"{scheme}://{quote(user, safe='')}:{quote(password, safe='')}@{rest}"


class SegmentNames:
    """Numbers the files of a recording from 0 on.

    Args:
        location: path, with a number's place in it (`%05d`) or without.
        is_cut: whether more than one file is to come: a number is then added where the name has none.

    Attributes:
        has_number: whether there can be more than one file.
        count: files named so far.
    """

    def __init__(self, location: str, is_cut: bool) -> None:
        self._pattern = location
        if is_cut and not NUMBER.search(location):
            path = Path(location)
            self._pattern = str(path.with_name(f"{path.stem}-%05d{path.suffix}"))
        self.has_number = len(NUMBER.findall(self._pattern)) == 1 and self._pattern.count("%") == 1
        self.count = 0

    def next_path(self) -> Path:
        """The path of the next file."""
        name = self._pattern % self.count if self.has_number else self._pattern
        self.count += 1
        return local_path(name)

    def take_back(self) -> None:
        """The last file named was not written: the next gets its name."""
        self.count -= 1
