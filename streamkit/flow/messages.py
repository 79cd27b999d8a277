"""Messages: what elements and the pipeline tell the application through the bus."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from streamkit.masking import presentable, presentable_value


class MessageKind(enum.StrEnum):
    """What a message is about."""

    ERROR = "error"
    WARNING = "warning"
    EOS = "eos"
    STATE = "state"
    ELEMENT = "element"


@dataclass(frozen=True, slots=True)
class Message:
    """One message on the bus; its texts are masked and bounded when it is made.

    Attributes:
        kind: error, warning, eos, state or element.
        source: name of the element, or "" for the pipeline.
        text: for people.
        fields: for programs; element messages carry their own name as `name`.
        error: the exception of an error message.
    """

    kind: MessageKind
    source: str = ""
    text: str = ""
    fields: Mapping[str, object] = field(default_factory=dict)
    error: Exception | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", presentable(self.text))
        object.__setattr__(self, "fields", presentable_value(self.fields))
