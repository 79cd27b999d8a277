"""What a page sends: messages taken, the choice of a feed, going back in time, requests to the pipeline."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from streamkit_zenoh.wire.control import ControlRequest

BACK_LIMIT_S = 3600
Natural = Annotated[int, msgspec.Meta(ge=0, le=2**53)]


class InvalidAnswer(ValueError):
    """A page sent something that pages do not send."""


class PageAnswer(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A message of a page, with exactly one field.

    Attributes:
        taken: how many messages the page has taken in all.
        select: index of the feed that it shows.
        back: how many seconds to go back in time; 0 is live.
        control: a live property to set; None asks for all of them.
    """

    taken: Natural | msgspec.UnsetType = msgspec.UNSET
    select: Natural | msgspec.UnsetType = msgspec.UNSET
    back: Annotated[int, msgspec.Meta(ge=0, le=BACK_LIMIT_S)] | msgspec.UnsetType = msgspec.UNSET
    control: ControlRequest | msgspec.UnsetType | None = msgspec.UNSET


_ANSWERS = msgspec.json.Decoder(PageAnswer)


def read_answer(text: object) -> tuple[str, Any]:
    """Reads a page's message: name and value of its field.

    Raises:
        InvalidAnswer: it is another.
    """
    try:
        answer = _ANSWERS.decode(text) if isinstance(text, str) else PageAnswer()
    except (ValueError, RecursionError):
        answer = PageAnswer()
    given = [
        (name, value)
        for name in PageAnswer.__struct_fields__
        if (value := getattr(answer, name)) is not msgspec.UNSET
    ]
    if len(given) != 1:
        raise InvalidAnswer(
            "it is no count of messages taken, choice of a feed, time to go back, or request to control"
        )
    return given[0]
