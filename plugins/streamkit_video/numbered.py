"""Words that also have a number and a label, as GStreamer's enumerations do."""

from __future__ import annotations

import enum
from typing import Self


class Numbered(enum.StrEnum):
    """Base of enumerations whose members are declared as (word, number, label).

    Attributes:
        number: GStreamer's number of the member.
        label: GStreamer's words for it.
    """

    number: int
    label: str

    def __new__(cls, word: str, number: int, label: str) -> Self:
        """A member with its number and label; its value is the word."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.number, member.label = number, label
        return member
