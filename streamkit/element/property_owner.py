"""PropertyOwner: the properties of an element, as its class declares them, one by one or as a dataclass."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Iterator
from typing import Any, ClassVar, Generic, Self, TypeVar, overload

from streamkit.element.property import SNAPSHOTS, PropertyDeclaration
from streamkit.errors import PropertyError, did_you_mean
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


class PropertyOwner:
    """The properties of an element, and the declarations of its class.

    Attributes:
        properties: declarations by name.
        defaults: default values by attribute.
        set_in_text: values given in the description, by the name of the property.
        is_playing: whether the pipeline streams; only live properties may change then.
    """

    properties: ClassVar[dict[str, PropertyDeclaration]] = {}
    defaults: ClassVar[dict[str, Any]] = {}
    name: str

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for item in vars(cls).values():
            if isinstance(item, PropertyDeclaration):
                item.check_declaration()
        cls.properties = _declared_properties(cls)
        cls.defaults = {item.attribute: item.default for item in cls.properties.values() if item.read is None}

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """A new element, its properties at their defaults."""
        self = super().__new__(cls)
        self.__dict__.update(cls.defaults)
        return self

    def __init__(self) -> None:
        super().__init__()
        self.set_in_text: dict[str, Any] = {}
        self.is_playing = False

    def post_warning(self, text: str, code: str = "") -> None:
        """Posts a warning message."""
        raise NotImplementedError

    def set_property(self, name: str, value: Any) -> None:
        """Sets a property by name, with dashes or underscores; ignores a read-only one with a warning.

        Raises:
            PropertyError: the property does not exist, refuses the value, or cannot change while playing.
        """
        declaration = self.find_property(name)
        if name.replace("-", "_") in declaration.aliases:
            text = f"property {name} is called {declaration.spelling} now; use that name"
            self.post_warning(text, "renamed-property")
        if declaration.readonly:
            declaration.check(value, self.name)
            text = f"property {declaration.spelling} can only be read; the value is ignored"
            self.post_warning(text, "read-only-property")
            return
        setattr(self, declaration.attribute, value)

    @classmethod
    def declaration_of(cls, name: str) -> PropertyDeclaration | None:
        """The declaration of a property by its name or an alias, or None."""
        plain = name.replace("-", "_")
        found = cls.properties.get(plain)
        return found or next((item for item in cls.properties.values() if plain in item.aliases), None)

    @classmethod
    def find_property(cls, name: str) -> PropertyDeclaration:
        """The declaration of a property; raises `PropertyError` with a suggestion if it does not exist."""
        declaration = cls.declaration_of(name)
        if declaration is None:
            hint = did_you_mean(name, [known.replace("_", "-") for known in cls.properties])
            raise PropertyError(f"{cls.__name__.lower()} has no property {name!r}{hint and '; ' + hint}")
        return declaration

    def properties_set(self) -> dict[str, Any]:
        """The properties set in the description, as JSON values."""
        declared = ((name, self.find_property(name)) for name in self.set_in_text)
        return {name: found.to_json(getattr(self, found.attribute)) for name, found in declared}


def check_attributes(element: PropertyOwner) -> None:
    """Checks that no attribute of an element is a misspelt property.

    It is one if the code of the element's class never names it, and a property has a similar name.

    Raises:
        PropertyError: names the attribute and the property.
    """
    owner: type = type(element)
    for attribute in vars(element).keys() - _names_in_code(owner):
        properties = [declared.attribute for declared in element.properties.values()]
        hint = did_you_mean(attribute, properties, 0.8)
        if hint and not attribute.startswith("_"):
            raise PropertyError(f"{element.name}: no property {attribute!r}; {hint}")


@functools.cache
def _names_in_code(owner: type) -> frozenset[str]:
    """The attributes of a class, and every name that the code of its methods uses."""
    names = set(dir(owner))
    for base in owner.__mro__:
        for member in vars(base).values():
            code = getattr(getattr(member, "fget", member), "__code__", None)
            names.update(code.co_names if code is not None else ())
    return frozenset(names)


def _declared_properties(owner: type) -> dict[str, PropertyDeclaration]:
    """All properties of an element class by name, those of its bases first; a subclass may redeclare one."""
    by_attribute: dict[str, PropertyDeclaration] = {}
    for base in reversed(owner.__mro__):
        for attribute, item in vars(base).items():
            if isinstance(item, SettingsOf):
                by_attribute.update(item.declarations)
            elif isinstance(item, PropertyDeclaration):
                by_attribute[attribute] = item
    return {item.name: item for item in by_attribute.values()}
