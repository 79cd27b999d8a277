"""What a description says of one element: its address, properties and presets, in textual order."""

from __future__ import annotations

import contextlib
import urllib.parse
from collections.abc import Iterable, Iterator
from dataclasses import replace

from streamkit.element.base import Element
from streamkit.element.property import PropertyDeclaration
from streamkit.element.registry import available_elements, element_class
from streamkit.errors import DescriptionError, Place, PluginBroken, StreamkitError, did_you_mean
from streamkit.flow.caps_text import unquote_string
from streamkit.flow.messages import Message
from streamkit.graph.bins import Bin
from streamkit.graph.parse import Assignment, ElementNode, resolve_escapes, unquote_value
from streamkit.masking import mask_secrets

ATTACHED = "a '!' that touches a value is part of it, as in gst-launch: put blanks around it"
Warnings = list[tuple[str, str]]
PendingProperty = tuple[Bin, Assignment]  # a child property whose child does not exist yet


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
            set_property(element, item, warnings)


def set_property(element: Element, item: Assignment, warnings: Warnings) -> PropertyDeclaration:
    """Sets a property of an element, whose warnings are added to those of the graph.

    Raises:
        DescriptionError: the property does not exist (code `no-such-property`), or refuses the value.
    """
    declaration = element.declaration_of(item.name)
    if declaration is None:
        raise _no_property(element, item)
    written = unquote_value(item.value)
    value: str | None = written

    def collect(message: Message) -> None:
        text = message.text.removeprefix("property ")
        warnings.append((str(message.fields["code"]), f"{element.name}: {text}"))

    element.poster = collect
    try:
        if declaration.kind is str and written == "NULL":  # GStreamer's null string
            value = None if declaration.optional else ""
        elif declaration.kind is str:
            value = unquote_string(written)
            doubts = _doubts(item.value, value)
            warnings.extend((code, f"{element.name}: {item.name} {rule}") for code, rule in doubts)
        element.set_property(item.name, value)
    except Exception as error:
        if not isinstance(error, StreamkitError):
            error = declaration.refusal(value, f"{type(error).__name__}: {error}", element.name)
        hint = ATTACHED if "!" in written else did_you_mean(value or "", declaration.choices)
        raise DescriptionError("could-not-set-property", str(error), item.place, hint) from None
    finally:
        element.poster = None
    if not declaration.readonly:
        element.set_in_text[declaration.spelling] = value
    return declaration


def _doubts(written: str, value: str) -> Iterator[tuple[str, str]]:
    """Code and rule of what gst-launch takes as it is, and was hardly meant, in a text and its value."""
    if value[:1] == value[-1:] == "'" and len(value) > 1:
        yield "quotes", "keeps its single quotes, as in gst-launch: use double ones"
    if written.startswith('"') and (written == '"' or not written.endswith('"')):
        yield "quotes", "has an opening quote, but does not end with one, as in gst-launch: close it"
    if '"' not in written and written.partition("!")[2].partition("!")[0] in available_elements():
        yield "attached-link", f"takes in what follows it: {ATTACHED}"
    if value == "!":
        rule = 'has no value and takes the next word, "!", as in gst-launch: give it one, if only ""'
        yield "no-value", rule


def _no_property(element: Element, item: Assignment) -> DescriptionError:
    """The error for a property that an element does not have."""
    from streamkit.element.gstreamer_names import property_hint

    if item.name == "parent":
        rule = "the parent of an element is the bin that contains it"
        return DescriptionError("could-not-set-property", rule, item.place)
    known = ["name", *(known.spelling for known in element.properties.values())]
    hint = property_hint(element.factory, item.name) or did_you_mean(item.name, known)
    return DescriptionError(
        "no-such-property", f"{element.factory} has no property {item.name!r}", item.place, hint
    )


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


def set_on_bin(group: Bin, assignments: tuple[Assignment, ...], warnings: Warnings) -> list[PendingProperty]:
    """Sets properties of a bin and its children; returns those of children that do not exist yet.

    Raises:
        DescriptionError: a property is unknown or refuses its value.
    """
    waiting = []
    for item in assignments:
        if "::" in item.name:
            if not try_child(group, item, warnings):
                waiting.append((group, item))
        elif item.name == "name":
            group.name = name_value(item) or group.name
        elif set_property(group, item, warnings).attribute in group.ignored:
            text = f"{group.name}: {item.name} is accepted for gst-launch's sake and changes nothing here"
            warnings.append(("no-effect", text))
    return waiting


def try_child(group: Bin, item: Assignment, warnings: Warnings) -> bool:
    """Sets a child property if the child exists; whether it did; raises `DescriptionError`."""
    *path, name = item.name.split("::")
    target: Element | None = group
    for step in path:
        target = target.child(step) if isinstance(target, Bin) else None
    if target is None:
        return False
    try:
        set_property(target, replace(item, name=name), warnings)
    except DescriptionError as error:
        raise DescriptionError("could-not-set-property", error.message, item.place, error.hint) from None
    return True


def factory_for(url: str, *, as_source: bool, place: Place) -> str:
    """The element type for a URI: named after its scheme and side, else the one of the highest rank.

    Raises:
        DescriptionError: code `no-such-element`.
    """
    kind = "source" if as_source else "sink"
    scheme, mark, _ = url.partition("://")
    if not mark:
        raise DescriptionError(
            "no-such-element", f"no {kind} element for the path {url!r}", place,
            "write file:///PATH, or filesrc location=PATH",
        )  # fmt: skip
    scheme = scheme.lower()
    plain = f"{scheme}{'src' if as_source else 'sink'}"
    if plain in available_elements():
        return plain
    found: list[tuple[int, str]] = []
    for name in available_elements():
        if name.endswith("src" if as_source else "sink"):
            with contextlib.suppress(PluginBroken, DescriptionError):
                known = element_class(name)
                found += [(known.rank, name)] if scheme in known.uri_schemes else []
    if not found:
        what = f"no {kind} element for scheme {scheme!r}: {mask_secrets(url)}"
        raise DescriptionError("no-such-element", what, place)
    return max(found)[1]


def location_of(url: str, place: Place) -> str:
    """The `location` for a URI: the path of a local file, else the URI itself; raises `DescriptionError`."""
    scheme, _, rest = url.partition("://")
    if scheme.lower() != "file":
        return url
    host, slash, path = rest.partition("/")
    if host not in ("", "localhost"):
        raise DescriptionError(
            "no-such-element", f"no element for files of the host {host!r}", place, f"write file:///{rest}"
        )
    return urllib.parse.unquote(slash + path)
