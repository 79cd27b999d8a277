"""Messages from elements and the pipeline to the application, sent on the bus."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from streamkit.masking import presentable, presentable_value

LOST_STATES = ("retrying", "gave-up")  # of the messages `connection`
SHORTFALLS = frozenset({"shortfall", "branch-dropped"})  # codes of warnings


class MessageKind(enum.StrEnum):
    """Kind of a message."""

    ERROR = "error"
    WARNING = "warning"
    EOS = "eos"
    STATE = "state"
    ELEMENT = "element"


@dataclass(frozen=True, slots=True)
class Message:
    """One message on the bus; secrets in its texts are masked, and their lengths bounded.

    Attributes:
        source: name of the element, or "" for the pipeline.
        text: for people.
        fields: for programs; those of an element message include its `name`.
        error: the exception of an error message.
    """

    kind: MessageKind
    source: str = ""
    text: str = ""
    fields: Mapping[str, object] = field(default_factory=dict)
    error: Exception | None = None

    @property
    def is_shortfall(self) -> bool:
        """Whether it warns that something that the pipeline is for was not made."""
        return self.fields.get("code") in SHORTFALLS

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", presentable(self.text))
        object.__setattr__(self, "fields", presentable_value(self.fields))


class LostConnections:
    """The elements that have lost their connection, by their messages `connection`.

    Attributes:
        states: "retrying" or "gave-up", by element.
    """

    def __init__(self) -> None:
        self.states: dict[str, str] = {}

    def update(self, message: Message) -> bool:
        """Takes a message; returns whether it says that a lost connection is made again."""
        if message.fields.get("name") != "connection":
            return False
        state = str(message.fields.get("state"))
        if state in LOST_STATES:
            self.states[message.source] = state
        return state == "connected" and self.states.pop(message.source, None) is not None
