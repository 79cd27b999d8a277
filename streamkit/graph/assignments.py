"""What a description sets on an element: properties, one by one in textual order, then presets."""

from __future__ import annotations

from collections.abc import Iterable

from streamkit.element.base import Element
from streamkit.element.property import PropertyDeclaration
from streamkit.element.property_text import unquote_string, value_from_text
from streamkit.element.suggest import did_you_mean
from streamkit.errors import DescriptionError, Place, StreamkitError
from streamkit.graph.parse import resolve_escapes, unquote_value
from streamkit.graph.syntax import Assignment, ElementNode

Warnings = list[tuple[str, str]]


def name_in_text(node: ElementNode, warnings: Warnings) -> str:
    """The name that an element is given, or ""; of several the first counts."""
    names = [item for item in node.assignments if item.name == "name"]
    for item in names[1:]:
        warnings.append(("name-ignored", f"{item.name}={item.value}: {node.factory} has a name already"))
    return name_value(names[0]) if names else ""


def name_value(item: Assignment) -> str:
    """The name that an assignment gives; "" where it asks for an automatic one.

    Raises:
        DescriptionError: its quotes or escapes are broken.
    """
    try:
        value = unquote_value(item.value)
        return "" if value == "NULL" else unquote_string(value)
    except ValueError as error:
        raise DescriptionError(
            "could-not-set-property", f"the name {item.value}: {error}", item.place
        ) from None


def set_properties(element: Element, assignments: Iterable[Assignment], warnings: Warnings) -> None:
    """Sets what stands behind an element, save its name.

    Raises:
        DescriptionError: the first property that is unknown, or whose value is refused.
    """
    for item in assignments:
        if item.name != "name":
            declaration = find_declaration(element, item, warnings)
            set_text(element, declaration, unquote_value(item.value), item.place, warnings)


def find_declaration(element: Element, item: Assignment, warnings: Warnings) -> PropertyDeclaration:
    """The property that an assignment means; an older name is accepted with a warning.

    Raises:
        DescriptionError: code `no-such-property`; `could-not-set-property` for `parent`.
    """
    declaration = element.declaration_of(item.name)
    if declaration is not None:
        if item.name.replace("-", "_") in declaration.aliases:
            what = f"{element.name}: {item.name} is called {declaration.spelling} now; use that name"
            warnings.append(("renamed-property", what))
        return declaration
    if item.name == "parent":
        rule = "an element's parent is the bin in whose brackets it stands"
        raise DescriptionError("could-not-set-property", rule, item.place)
    hint = did_you_mean(item.name, ["name", *(known.spelling for known in element.properties.values())])
    raise DescriptionError(
        "no-such-property", f"{element.factory} has no property {item.name!r}", item.place, hint
    )


def set_text(
    element: Element, declaration: PropertyDeclaration, text: str, place: Place, warnings: Warnings
) -> None:
    """Sets a property from its text, launch-level quotes removed.

    Raises:
        DescriptionError: code `could-not-set-property`.
    """
    if declaration.readonly:
        _demand_readable(element, declaration, text, place)
        what = f"{element.name}: {declaration.spelling} can only be read; {text} is ignored"
        warnings.append(("read-only-property", what))
        return
    try:
        value: str | None = text
        if declaration.kind is str:
            value = unquote_string(text)
            if text == "NULL":  # how GStreamer writes a text that is not there
                value = None if declaration.optional else ""
        element.set_property(declaration.name, value)
    except Exception as error:
        if not isinstance(error, StreamkitError):
            error = declaration.refusal(text, f"{type(error).__name__}: {error}", element.name)
        hint = did_you_mean(text, declaration.choices) if declaration.choices else ""
        raise DescriptionError("could-not-set-property", str(error), place, hint) from None
    element.set_in_text[declaration.spelling] = text


def _demand_readable(element: Element, declaration: PropertyDeclaration, text: str, place: Place) -> None:
    """Refuses what is no value of the property's type, even though a value would be ignored."""
    try:
        value_from_text(declaration.kind, text)
    except ValueError as error:
        refusal = declaration.refusal(text, str(error), element.name)
        raise DescriptionError("could-not-set-property", str(refusal), place) from None


def load_presets(element: Element, presets: Iterable[Assignment]) -> None:
    """Sets the values of each preset, over those that stand in the text.

    Raises:
        DescriptionError: the element has no such preset.
    """
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
