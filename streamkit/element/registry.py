"""Registry: finds elements by entry point and imports only those that are used."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
from collections.abc import Iterator
from typing import Any, TypeVar

from streamkit.element.base import Element
from streamkit.element.code_place import place_in_plugin
from streamkit.element.entries import PluginEntry, entries_by_name, installed_entries
from streamkit.errors import DescriptionError, Place, PluginBroken, StreamkitError, did_you_mean

GROUP = "streamkit.elements"
IDENTIFIER = r"[A-Za-z0-9_][A-Za-z0-9_\-%:]*"  # a name as descriptions write it
ElementClass = TypeVar("ElementClass", bound=type[Element])
_registered: dict[str, type[Element]] = {}


def is_registered(name: str) -> bool:
    """Whether the running program has registered the element of this name."""
    return name in _registered


def register_element(found: ElementClass, name: str = "") -> ElementClass:
    """Makes a class usable in the descriptions of this program, without a package; also as a decorator.

    A later class of the same name takes the place of the first, as when a notebook's cell runs again. Bins
    with `process=true` need a package, `streamkit new` makes one.

    Args:
        found: the class.
        name: what it is called in descriptions; the name of the class in lower case if empty.

    Raises:
        TypeError: it is no subclass of `Element`.
        ValueError: an installed package has an element of the name, or no description can hold it.
    """
    given: object = found
    if not (isinstance(given, type) and issubclass(given, Element)):
        remedy = f'; write register_element(CLASS, "{given}")' if isinstance(given, str) else ""
        raise TypeError(f"register_element takes a subclass of streamkit.Element, got {given!r}{remedy}")
    name = name or found.__name__.lower()
    if not re.fullmatch(IDENTIFIER, name):
        raise ValueError(
            f"an element's name must be letters a to z, digits, _ or -, not - first, got {name!r}; "
            f'write register_element({found.__name__}, "NAME")'
        )
    entry = available_elements().get(name)
    if entry is not None and not is_registered(name):
        raise ValueError(f"{entry.where} is installed; register {found.__name__} by another name")
    _registered[name] = found
    available_elements.cache_clear()
    element_class.cache_clear()
    return found


@functools.cache
def available_elements() -> dict[str, PluginEntry]:
    """Elements of installed packages, and those of the running program, by name; streamkit's own win."""
    registered = [
        PluginEntry("element", name, f"{found.__module__}:{found.__qualname__}")
        for name, found in _registered.items()
    ]
    return entries_by_name([*installed_entries("element", GROUP), *registered])


@functools.cache
def element_class(name: str) -> type[Element]:
    """The class of an element, imported unless it is registered.

    Raises:
        DescriptionError: no installed package has it (code `no-such-element`).
        PluginBroken: it cannot be imported, is not an element, or two packages other than streamkit have it.
    """
    if is_registered(name):
        return _registered[name]
    entry = available_elements().get(name)
    if entry is None:
        from streamkit.element.gstreamer_names import gstreamer_hint

        raise DescriptionError(
            "no-such-element",
            f'no element "{name}"',
            hint=gstreamer_hint(name) or did_you_mean(name, available_elements()),
        )
    if entry.rivals and not entry.is_own:
        raise PluginBroken(f"{entry.rivalry}; uninstall one of them")
    found = entry.load()
    if not (isinstance(found, type) and issubclass(found, Element)):
        raise PluginBroken(
            f"{entry.where} must be a subclass of streamkit.Element, got {found!r}; tell its author"
        )
    return found


@contextlib.contextmanager
def located(place: Place | None) -> Iterator[None]:
    """Context that turns errors of finding or making an element into a `DescriptionError` with a place."""
    try:
        yield
    except DescriptionError as error:
        raise error.at(place or error.place) from None
    except PluginBroken as error:
        raised_at = place_in_plugin(error.__cause__) if error.__cause__ is not None else ""
        hint = f"raised at {raised_at}" if raised_at else ""
        raise DescriptionError("plugin-broken", str(error), place, hint) from error


def make_element(factory: str, name: str = "", **properties: Any) -> Element:
    """Makes an element of a type.

    Raises:
        DescriptionError: there is no such element.
        PluginBroken: it cannot be loaded or made, or its constructor takes no name.
        PropertyError: a property is unknown or refuses its value.
    """
    found = element_class(factory)
    given = name or factory
    try:
        element = found(given, **properties)
    except StreamkitError:
        raise
    except (Exception, SystemExit) as cause:
        _check_constructor(found)
        if is_registered(factory):
            raise  # with the traceback, for its author
        raise available_elements()[factory].broken("made", cause) from cause
    if getattr(element, "name", None) != given:
        raise _wrong_constructor(found)
    element.factory = factory
    return element


def _check_constructor(found: type[Element]) -> None:
    """Checks that a class can be called with a name.

    Raises:
        PluginBroken: its author has written an `__init__` that takes none.
    """
    try:
        inspect.signature(found).bind("name")
    except TypeError:
        raise _wrong_constructor(found) from None


def _wrong_constructor(found: type[Element]) -> PluginBroken:
    return PluginBroken(
        f"{found.__module__}:{found.__qualname__}: its __init__ must take name and **properties and pass "
        "them to super().__init__; to set up state, write start in its place"
    )
