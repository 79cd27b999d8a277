"""Registry: finds elements through entry points and imports only those that a graph uses."""

from __future__ import annotations

import functools
import importlib.metadata
from dataclasses import dataclass
from typing import Any

from streamkit.element.base import Element
from streamkit.element.suggest import did_you_mean
from streamkit.errors import DescriptionError, PluginBroken, StreamkitError

GROUP = "streamkit.elements"


@dataclass(frozen=True, slots=True)
class ElementEntry:
    """An element that an installed package offers; nothing of it is imported yet.

    Attributes:
        name: as written in descriptions.
        target: "module:Class".
        distribution: who offers it; its metadata are read only when they are asked for, which takes time.
    """

    name: str
    target: str
    distribution: importlib.metadata.Distribution | None = None

    @property
    def package(self) -> str:
        """Name of the distribution."""
        return self.distribution.name if self.distribution else "unknown package"

    @property
    def version(self) -> str:
        """Version of the distribution."""
        return self.distribution.version if self.distribution else ""

    @property
    def where(self) -> str:
        """Element, class and package in a few words."""
        return f"element {self.name!r} ({self.target}, {self.package} {self.version})"


@functools.cache
def installed_elements() -> dict[str, ElementEntry]:
    """All elements of all installed packages by name; of two with one name the first found wins."""
    found: dict[str, ElementEntry] = {}
    for entry in importlib.metadata.entry_points(group=GROUP):
        found.setdefault(entry.name, ElementEntry(entry.name, entry.value, entry.dist))
    return dict(sorted(found.items()))


@functools.cache
def element_class(name: str) -> type[Element]:
    """The class of an element, imported now.

    Raises:
        DescriptionError: no installed package has it (code `no-such-element`).
        PluginBroken: it cannot be imported, or is no element.
    """
    entry = installed_elements().get(name)
    if entry is None:
        raise DescriptionError(
            "no-such-element", f'no element "{name}"', hint=did_you_mean(name, installed_elements())
        )
    module_name, _, class_name = entry.target.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module_name), class_name)
    except Exception as cause:
        raise PluginBroken(
            f"{entry.where} cannot be loaded: {type(cause).__name__}: {cause}; "
            f"reinstall or update {entry.package}, or tell its author"
        ) from cause
    if not (isinstance(found, type) and issubclass(found, Element)):
        raise PluginBroken(
            f"{entry.where} must be a subclass of streamkit.Element, got {found!r}; tell its author"
        )
    return found


def make_element(factory: str, name: str = "", **properties: Any) -> Element:
    """A new element by the name of its type.

    Raises:
        DescriptionError: there is no such element.
        PluginBroken: it cannot be loaded or made.
        PropertyError: a property is unknown or its value refused.
    """
    found = element_class(factory)
    try:
        element = found(name or factory, **properties)
    except StreamkitError:
        raise
    except Exception as cause:
        entry = installed_elements()[factory]
        raise PluginBroken(
            f"{entry.where} cannot be made: {type(cause).__name__}: {cause}; "
            f"reinstall or update {entry.package}, or tell its author"
        ) from cause
    element.factory = factory
    return element
