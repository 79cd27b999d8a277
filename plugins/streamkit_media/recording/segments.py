"""Names of the files that one recording is cut into."""

from __future__ import annotations

import re
from pathlib import Path

from streamkit_media.location import local_path

NUMBER = re.compile(r"%0?\d*d")


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
