"""Choice: an enumeration whose members also have a number and a label, as GStreamer's have."""

from __future__ import annotations

import enum


class Choice(enum.StrEnum):
    """Base of enumerations for properties: a member is written by its word, its number or its label.

    A member is declared as a word, or as (word, number, label); numbers left out count on from the member
    before, a label left out is the word:

        class Leaky(Choice):
            NO = "no", 0, "Not Leaky"
            UPSTREAM = "upstream", 1, "Leaky on upstream (new buffers)"

    Attributes:
        number: what also stands for it in a description.
        label: a few words about it, which also stand for it.
    """

    number: int
    label: str

    def __new__(cls, word: str, number: int | None = None, label: str = "") -> Choice:
        """A member; its value is the word."""
        member = str.__new__(cls, word)
        member._value_ = word
        previous = list(cls.__members__.values())
        member.number = number if number is not None else previous[-1].number + 1 if previous else 0
        member.label = label or word
        return member
