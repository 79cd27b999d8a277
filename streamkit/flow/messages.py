"""Messages from elements and the pipeline to the application, sent on the bus."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from streamkit.masking import presentable, presentable_value

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
