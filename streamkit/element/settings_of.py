"""SettingsOf: a dataclass of settings as properties of an element."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterator
from typing import Any, Generic, TypeVar, overload

from streamkit.element.property import SNAPSHOTS, PropertyDeclaration
from streamkit.settings import Traits, traits_of

T = TypeVar("T")


class SettingsOf(Generic[T]):
    """Declares a property for each `setting` of a frozen dataclass; reading it gives an instance.

    Nested settings dataclasses add their own settings; other fields keep their defaults. The instance is
    cached until a property is set.
    """

    def __init__(self, kind: type[T]) -> None:
        self.kind = kind
        self.declarations = _declarations(kind)

    def __set_name__(self, owner: type, attribute: str) -> None:
        for name, declaration in self.declarations.items():
            declaration.__set_name__(owner, name)
            setattr(owner, name, declaration)

    @overload
    def __get__(self, instance: None, owner: type) -> SettingsOf[T]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> SettingsOf[T] | T:
        if instance is None:
            return self
        snapshots = vars(instance).setdefault(SNAPSHOTS, {})
        found: T | None = snapshots.get(self.kind)
        if found is None:
            found = snapshots[self.kind] = _snapshot(self.kind, vars(instance))
        return found


def _fields(kind: Any) -> Iterator[tuple[str, Traits | None, Any]]:
    """Name, traits and default of each field of a settings dataclass."""
    for field in dataclasses.fields(kind):
        factory = field.default_factory
        default = field.default if factory is dataclasses.MISSING else factory()
        yield field.name, traits_of(field), default


def _declarations(kind: Any) -> dict[str, PropertyDeclaration]:
    """The properties that a settings dataclass and those nested in it declare."""
    found: dict[str, PropertyDeclaration] = {}
    kinds = typing.get_type_hints(kind)
    for name, traits, default in _fields(kind):
        if traits is not None:
            found[name] = PropertyDeclaration(default, "", traits, kinds[name])
        elif dataclasses.is_dataclass(default):
            found.update(_declarations(type(default)))
    return found


def _snapshot(kind: Any, values: dict[str, Any]) -> Any:
    """An instance of a settings dataclass with the values of an element."""
    given = {}
    for name, traits, default in _fields(kind):
        if traits is not None:
            given[name] = values[name]
        elif dataclasses.is_dataclass(default):
            given[name] = _snapshot(type(default), values)
    return kind(**given)
