"""Applies assignments of a description to elements and bins, in textual order, then presets."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.element.property import PropertyDeclaration
from streamkit.element.property_text import unquote_string, value_from_text
from streamkit.errors import DescriptionError, Place, StreamkitError, did_you_mean
from streamkit.graph.bins import Bin
from streamkit.graph.parse import Assignment, ElementNode, resolve_escapes, unquote_value

Warnings = list[tuple[str, str]]


def name_in_text(node: ElementNode, warnings: Warnings) -> str:
    """The name given to an element, or ""; the first of several."""
    names = [item for item in node.assignments if item.name == "name"]
    for item in names[1:]:
        warnings.append(("name-ignored", f"{item.name}={item.value}: {node.factory} has a name already"))
    return name_value(names[0]) if names else ""


def name_value(item: Assignment) -> str:
    """The name in an assignment, "" for an automatic one; raises `DescriptionError`."""
    try:
        value = unquote_value(item.value)
        return "" if value == "NULL" else unquote_string(value)
    except ValueError as error:
        raise DescriptionError(
            "could-not-set-property", f"the name {item.value}: {error}", item.place
        ) from None


def set_properties(element: Element, assignments: Iterable[Assignment], warnings: Warnings) -> None:
    """Sets the properties of an element, except its name; raises the first `DescriptionError`."""
    for item in assignments:
        if item.name != "name":
            declaration = find_declaration(element, item, warnings)
            set_text(element, declaration, unquote_value(item.value), item.place, warnings)


def find_declaration(element: Element, item: Assignment, warnings: Warnings) -> PropertyDeclaration:
    """The property of an assignment; aliases are accepted with a warning; raises `DescriptionError`."""
    declaration = element.declaration_of(item.name)
    if declaration is not None:
        if item.name.replace("-", "_") in declaration.aliases:
            what = f"{element.name}: {item.name} is called {declaration.spelling} now; use that name"
            warnings.append(("renamed-property", what))
        return declaration
    if item.name == "parent":
        rule = "the parent of an element is the bin that contains it"
        raise DescriptionError("could-not-set-property", rule, item.place)
    hint = did_you_mean(item.name, ["name", *(known.spelling for known in element.properties.values())])
    raise DescriptionError(
        "no-such-property", f"{element.factory} has no property {item.name!r}", item.place, hint
    )


def set_text(
    element: Element, declaration: PropertyDeclaration, text: str, place: Place, warnings: Warnings
) -> None:
    """Sets a property from text without launch-level quotes; raises `DescriptionError`."""
    if declaration.readonly:
        _check_readable(element, declaration, text, place)
        what = f"{element.name}: {declaration.spelling} can only be read; {text} is ignored"
        warnings.append(("read-only-property", what))
        return
    try:
        value: str | None = text
        if declaration.kind is str:
            value = unquote_string(text)
            if text == "NULL":  # GStreamer's null string
                value = None if declaration.optional else ""
        element.set_property(declaration.name, value)
    except Exception as error:
        if not isinstance(error, StreamkitError):
            error = declaration.refusal(text, f"{type(error).__name__}: {error}", element.name)
        hint = did_you_mean(text, declaration.choices) if declaration.choices else ""
        raise DescriptionError("could-not-set-property", str(error), place, hint) from None
    element.set_in_text[declaration.spelling] = text


def _check_readable(element: Element, declaration: PropertyDeclaration, text: str, place: Place) -> None:
    """Refuses a text of the wrong type for a read-only property."""
    try:
        value_from_text(declaration.kind, text)
    except ValueError as error:
        refusal = declaration.refusal(text, str(error), element.name)
        raise DescriptionError("could-not-set-property", str(refusal), place) from None


def load_presets(element: Element, presets: Iterable[Assignment]) -> None:
    """Sets the values of presets, which replace those in the text; raises `DescriptionError`."""
    for item in presets:
        known = element.presets
        if not known:
            raise DescriptionError("could-not-set-property", f"{element.factory} has no presets", item.place)
        name = resolve_escapes(item.value)
        if name not in known:
            raise DescriptionError(
                "could-not-set-property", f"{element.factory} has no preset {name!r}", item.place,
                did_you_mean(name, known) or f"it has {', '.join(known)}",
            )  # fmt: skip
        for property_name, value in known[name].items():
            try:
                element.set_property(property_name, value)
            except StreamkitError as error:
                raise DescriptionError("could-not-set-property", str(error), item.place) from None
            element.set_in_text[element.find_property(property_name).spelling] = value


@dataclass(frozen=True, slots=True)
class PendingProperty:
    """A child property whose child does not exist yet."""

    group: Bin
    assignment: Assignment


def set_on_bin(group: Bin, assignments: tuple[Assignment, ...], warnings: Warnings) -> list[PendingProperty]:
    """Sets properties of a bin and its children; returns those of children that do not exist yet.

    Raises:
        DescriptionError: a property is unknown or refuses its value.
    """
    waiting = []
    for item in assignments:
        if "::" in item.name:
            pending = PendingProperty(group, item)
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


def try_child(pending: PendingProperty, warnings: Warnings) -> bool:
    """Sets a child property if the child exists; whether it did; raises `DescriptionError`."""
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
