"""Choice: an enumeration whose members have a number and a label, as in GStreamer."""

from __future__ import annotations

import enum


class Choice(enum.StrEnum):
    """Base class of property enumerations: users write the word, the number or the label of a member.

    A member is declared as a word, or as (word, number, label). The default number is one more than the
    previous member's, the default label is the word:

        class Leaky(Choice):
            NO = "no", 0, "Not Leaky"
            UPSTREAM = "upstream", 1, "Leaky on upstream (new buffers)"
    """

    number: int
    label: str

    def __new__(cls, word: str, number: int | None = None, label: str = "") -> Choice:
        """Makes a member whose value is the word."""
        member = str.__new__(cls, word)
        member._value_ = word
        previous = list(cls.__members__.values())
        member.number = number if number is not None else previous[-1].number + 1 if previous else 0
        member.label = label or word
        return member
