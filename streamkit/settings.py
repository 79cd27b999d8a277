"""Settings of algorithms, which are properties of elements.

An algorithm declares a frozen dataclass whose fields are `setting(...)`. The element that runs it says
`settings = SettingsOf(ThatClass)`: each field is then a property of the element with the same name, and
`self.settings` is a snapshot of their values. This module is independent of the engine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

TRAITS = "streamkit.traits"
FileUse = Literal["", "read", "write"]


@dataclass
class Traits:
    """The traits of a property besides its default.

    Attributes:
        minimum: smallest value allowed, or None.
        maximum: largest value allowed, or None.
        unit: of the number, or "".
        doc: one sentence.
        live: whether it may change while the pipeline plays.
        secret: whether its value is never shown.
        readonly: whether only the element itself sets it.
        read: works the value out of the element, or None where it is stored.
        aliases: older names, accepted with a warning.
        file: "read" or "write" where the value names a file, else "".
    """

    minimum: Any = None
    maximum: Any = None
    unit: str = ""
    doc: str = ""
    live: bool = False
    secret: bool = False
    readonly: bool = False
    read: Callable[[Any], Any] | None = None
    aliases: tuple[str, ...] = ()
    file: FileUse = ""


def setting(
    default: Any,
    *,
    min: float | Fraction | None = None,
    max: float | Fraction | None = None,
    unit: str = "",
    doc: str = "",
    live: bool = False,
    aliases: tuple[str, ...] = (),
    file: FileUse = "",
) -> Any:
    """Declares a field of a settings dataclass that is a property of the element, too.

    The arguments are the attributes of `Traits`, and the value of a new element.
    """
    traits = Traits(min, max, unit, doc, live, aliases=aliases, file=file)
    return dataclasses.field(default=default, metadata={TRAITS: traits})


def traits_of(field: dataclasses.Field[Any]) -> Traits | None:
    """The traits of a field, or None if it is no property."""
    return field.metadata.get(TRAITS)
