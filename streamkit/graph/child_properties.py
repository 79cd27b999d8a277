"""Properties that a bin's brackets set on what stands in the bin: `child::property=value`."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.errors import DescriptionError
from streamkit.graph.assignments import Warnings, find_declaration, name_value, set_text
from streamkit.graph.bins import Bin
from streamkit.graph.parse import unquote_value
from streamkit.graph.syntax import Assignment


@dataclass(frozen=True, slots=True)
class WaitingProperty:
    """A child property whose child has not come yet."""

    group: Bin
    assignment: Assignment


def set_on_bin(group: Bin, assignments: tuple[Assignment, ...], warnings: Warnings) -> list[WaitingProperty]:
    """Sets a bin's own properties and those of its children, in textual order; what has to wait.

    Raises:
        DescriptionError: a property is unknown or its value refused.
    """
    waiting = []
    for item in assignments:
        if "::" in item.name:
            pending = WaitingProperty(group, item)
            if not try_child(pending, warnings):
                waiting.append(pending)
        elif item.name == "name":
            group.name = name_value(item) or group.name
        else:
            declaration = find_declaration(group, item, warnings)
            set_text(group, declaration, unquote_value(item.value), item.place, warnings)
            if not declaration.readonly:
                text = f"{group.name}: {item.name} is accepted for gst-launch's sake and changes nothing here"
                warnings.append(("no-effect", text))
    return waiting


def try_child(pending: WaitingProperty, warnings: Warnings) -> bool:
    """Sets a child property if its child is there; whether it was.

    Raises:
        DescriptionError: the child has no such property, or refuses the value.
    """
    item = pending.assignment
    *path, name = item.name.split("::")
    target: Element | None = pending.group
    for step in path:
        target = target.child(step) if isinstance(target, Bin) else None
    if target is None:
        return False
    inner = Assignment(name, item.value, item.place)
    try:
        declaration = find_declaration(target, inner, warnings)
    except DescriptionError as error:
        raise DescriptionError("could-not-set-property", error.message, item.place, error.hint) from None
    set_text(target, declaration, unquote_value(item.value), item.place, warnings)
    return True
