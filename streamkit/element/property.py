"""Properties: declared once on the class for signature, `inspect`, documentation and errors."""

from __future__ import annotations

import enum
import functools
import inspect
import math
import os
import re
import sys
import types
import typing
from collections.abc import Callable
from fractions import Fraction
from typing import Any, TypeVar, cast

from streamkit.element.property_text import PLAIN_KINDS, flag_word, value_from_text
from streamkit.errors import PropertyError
from streamkit.flow.caps import Caps
from streamkit.flow.video import exact_rate
from streamkit.masking import MASK, mask_secrets
from streamkit.settings import FileUse, Traits

T = TypeVar("T")
SNAPSHOTS = "_settings_snapshots"  # in an element's __dict__: settings by class, until a property is set
NAME = "name"  # in a description it names the element
# By class, the public attributes that it declares for its subclasses to set, or sets on each element.
ATTRIBUTES = {
    "PropertyOwner": {"defaults", "is_playing", "properties", "set_in_text"},
    "PadOwner": {"pad_templates", "pads", "sink", "src", "templates"},
    "Waits": {
        "activity", "changed", "clock", "flushes", "is_flushing", "is_waiting", "lock", "stopping", "timing",
        "waited_ns",
    },
    "Element": {
        "at_work", "bin", "drops", "factory", "has_failed", "host", "outcomes", "poster", "presets", "rank",
        "results", "uri_schemes", "written_paths",
    },
    "Source": {"over", "position_ns"},
    "Sink": {"position_ns"},
    "Transform": {"keeps_caps"},
    "Combine": {"combine_lock"},
    "FrameHolder": {"limits", "pending"},
    "OutputFileSink": {"example", "file", "has_begun", "names", "number", "suffixes", "write_errors"},
    "NumberedFilesSink": {"remembers_earlier_runs"},
    "TextFileSink": {"content", "file", "formats", "kinds"},
}  # fmt: skip


class PropertyDeclaration(Traits):
    """A property, declared by `Property(...)` in a class body; checks values that are set.

    It has no `__get__`: the value is in the instance's `__dict__`, so that reading it costs no call.

    Attributes:
        name: as users write it, with underscores.
        attribute: its name in the class.
    """

    def __init__(self, default: Any, name: str, traits: Traits, annotation: Any = None) -> None:
        super().__init__(**vars(traits))
        self.default = default
        self.name = name.replace("-", "_")
        self.attribute = ""
        self.owner: type = object
        self._annotation = annotation

    def __set_name__(self, owner: type, attribute: str) -> None:
        self.owner, self.attribute = owner, attribute
        self.name = self.name or attribute

    def __set__(self, instance: Any, value: Any) -> None:
        if getattr(instance, "is_playing", False) and not (self.live or self.readonly):
            raise PropertyError(
                f"{instance.name}: property {self.spelling} cannot change while playing; "
                "stop the pipeline to set it"
            )
        checked = self.check(value, getattr(instance, "name", ""))
        instance.__dict__[self.attribute] = checked
        instance.__dict__.pop(SNAPSHOTS, None)
        changed = getattr(instance, "property_changed", None)
        if changed is not None:
            changed(self.attribute)

    @property
    def spelling(self) -> str:
        """The name with dashes, as in descriptions."""
        return self.name.replace("_", "-")

    @property
    def kind(self) -> type:
        """Type of the value: int, float, bool, str, Fraction, Caps, an enum or flags."""
        return self._kind_and_optional[0]

    @property
    def optional(self) -> bool:
        """Whether the value may be None."""
        return self._kind_and_optional[1]

    @functools.cached_property
    def _kind_and_optional(self) -> tuple[type, bool]:
        annotation = self._annotation
        if annotation is None:
            annotation = inspect.get_annotations(self.owner).get(self.attribute, type(self.default))
        if isinstance(annotation, str):
            names = vars(sys.modules[self.owner.__module__])
            annotation = eval(annotation, dict(names))  # the author's own annotation
        is_union = isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union
        members = typing.get_args(annotation) if is_union else (annotation,)
        plain = [member for member in members if member is not type(None)]
        if len(plain) != 1 or not isinstance(plain[0], type):
            where = f"{self.owner.__name__}.{self.attribute}"
            raise TypeError(f"property {where}: annotate it with one type, or `type | None`")
        return plain[0], len(plain) != len(members)

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that an enum or flags property accepts; empty for other types."""
        kind = self.kind
        if issubclass(kind, enum.Flag):
            return tuple(flag_word(member) for member in kind)
        return tuple(str(member.value) for member in kind) if issubclass(kind, enum.Enum) else ()

    def describe(self) -> str:
        """Type, range and unit, for people."""
        kind = self.kind
        words = (" + " if issubclass(kind, enum.Flag) else " | ").join(self.choices) or kind.__name__
        if self.minimum is not None or self.maximum is not None:
            low = "" if self.minimum is None else self.minimum
            high = "" if self.maximum is None else self.maximum
            words += f" {low}..{high}"
        return f"{words} {self.unit}".strip()

    def check(self, value: Any, element: str = "") -> Any:
        """Converts a value to the property's type.

        Raises:
            PropertyError: wrong type or out of range.
        """
        if value is None and self.optional:
            return None
        try:
            converted = self._converted(value)
        except (ValueError, OverflowError) as error:
            raise self.refusal(value, str(error), element) from None
        if rule := self._broken_rule(converted):
            raise self.refusal(converted, rule, element)
        return converted

    def _converted(self, value: Any) -> Any:
        """A text, number or path as a value of the property's type; any other value as it is.

        Raises:
            ValueError, OverflowError: a text or number is no such value.
        """
        kind = self.kind
        if self.file and isinstance(value, str | os.PathLike):
            return os.path.expanduser(value)  # quotes keep the shell from it; a sink made a folder ~
        if isinstance(value, str) and kind is not str:
            return value_from_text(kind, value, minimum=self.minimum, maximum=self.maximum)
        if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if kind is Fraction and isinstance(value, int | float | Fraction):
            return exact_rate(value) if isinstance(value, float) else Fraction(value)
        return kind(value) if issubclass(kind, enum.Enum) else value

    def _broken_rule(self, value: Any) -> str:
        """The rule of type, file name or range that a value breaks, or ""."""
        kind = self.kind
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            return f"it takes {self.describe()}"
        if self.file and not _can_name_a_file(str(value)):
            return "a file's name holds no NUL and no half of a character"
        # Python reads bytes that are not UTF-8 as such halves, and native code crashes at them.
        if kind is str and not self.file and re.search("[\ud800-\udfff]", str(value)):
            return "a text holds no half of a character; give it in the terminal's encoding"
        too_low = self.minimum is not None and value < self.minimum
        too_high = self.maximum is not None and value > self.maximum
        is_nan = isinstance(value, float) and math.isnan(value)
        return f"it takes {self.describe()}" if too_low or too_high or is_nan else ""

    def check_declaration(self) -> None:
        """Checks that the name is free and the default is a value of the property.

        Raises:
            TypeError: it is not; names class, property, rule and remedy.
        """
        where = f"{self.owner.__name__}.{self.attribute}"
        if self.name == NAME:
            raise TypeError(f'{where}: "name" names the element in a description; rename the property')
        if use := use_of(self.owner, self.attribute):
            raise TypeError(f"{where}: the property hides {use}; rename it")
        try:
            kind, default = self.kind, self.default
            if kind not in PLAIN_KINDS and not issubclass(kind, enum.Enum):
                names = ", ".join(plain.__name__ for plain in PLAIN_KINDS)
                raise TypeError(
                    f"{where}: a property is {names}, an enum or flags, for a description to set it, got "
                    f'{kind.__name__}; write str with file="read" or "write" for a file, and keep any other '
                    "object in an attribute"
                )
            self.check(default)
        except NameError:
            return  # the annotation names what the module defines later
        except PropertyError as error:
            rule = str(error)
        else:
            if default is None or isinstance(default, kind) or kind in (float, Fraction):
                return
            rule = f"it must be {kind.__name__}, as the annotation says, got {default!r}"
        raise TypeError(f"{where}: the default does not fit the property: {rule}")

    def refusal(self, value: Any, rule: str, element: str) -> PropertyError:
        """The error for a value that the property refuses."""
        where = f"{element}: " if element else ""
        shown = repr(value)
        if self.secret:
            shown, rule = "the value given", rule.replace(str(value), MASK) if value else rule
        return PropertyError(f"{where}property {self.spelling} cannot be {shown}: {rule}")

    def to_json(self, value: Any) -> Any:
        """The value as JSON; secrets, and passwords in URLs, are masked."""
        if self.secret and value:
            return MASK
        if isinstance(value, enum.Flag):
            return "+".join(flag_word(member) for member in value)
        if isinstance(value, enum.Enum):
            return value.value
        if isinstance(value, str):
            return mask_secrets(value)
        return mask_secrets(str(value)) if isinstance(value, Fraction | Caps) else value


class ComputedProperty(PropertyDeclaration):
    """A property whose value is computed each time it is read."""

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None or self.read is None:
            return self
        return self.read(instance)

    def __set__(self, instance: Any, value: Any) -> None:
        raise AttributeError(f"property {self.spelling} of {self.owner.__name__} can only be read")


def Property(  # noqa: N802  reads as a declaration, like dataclasses.field
    default: T,
    *,
    name: str = "",
    min: float | Fraction | None = None,
    max: float | Fraction | None = None,
    unit: str = "",
    doc: str = "",
    live: bool = False,
    secret: bool = False,
    readonly: bool = False,
    read: Callable[[Any], T] | None = None,
    aliases: tuple[str, ...] = (),
    file: FileUse = "",
) -> T:
    """Declares a property in an element class; its type is the annotation.

    The arguments are the value of a new element and the attributes of `streamkit.settings.Traits`. `name` is
    what users write if it differs from the attribute, for example "async". `max` also gives the number of
    bits of an integer. `read` makes the property read-only. No two elements may use a file that one writes.
    """
    traits = Traits(min, max, unit, doc, live, secret, readonly or read is not None, read, aliases, file)
    kind = PropertyDeclaration if read is None else ComputedProperty
    return cast("T", kind(default, name, traits))


def _can_name_a_file(text: str) -> bool:
    try:
        return b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:
        return False


def use_of(owner: type, attribute: str) -> str:
    """What a base class of an element uses the name of a property for, such as "the method Element.stop".

    Args:
        owner: the class that declares the property.
        attribute: its name in the class.

    Returns:
        "" where the name is free. A plain value, such as `Source.is_live`, may become a property.
    """
    for base in owner.__mro__[1:]:
        found = vars(base).get(attribute)
        if inspect.isroutine(found):
            return f"the method {base.__name__}.{attribute}"
        is_engine = base.__module__.startswith("streamkit.")
        if is_engine and (isinstance(found, property) or attribute in ATTRIBUTES.get(base.__name__, ())):
            return f"the attribute {base.__name__}.{attribute}"
    return ""
