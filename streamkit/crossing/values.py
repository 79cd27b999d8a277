"""Values of metadata, properties and messages as plain structures that msgspec writes, and back.

Numbers, text, bytes and None stand for themselves; anything else is a list that begins with its `Tag`.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import importlib
import operator
import sys
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from streamkit.errors import StreamkitError
from streamkit.flow.caps import Caps

if TYPE_CHECKING:
    from numpy.typing import NDArray

PLAIN = frozenset({type(None), bool, int, float, str, bytes})


class CannotCross(StreamkitError):
    """A value that has no form in which it reaches another process."""


class Tag(enum.IntEnum):
    """What a list in an encoded value stands for."""

    TUPLE = 0
    LIST = 1
    MAPPING = 2
    SET = 3
    FROZEN_SET = 4
    ARRAY = 5
    SCALAR = 6  # of NumPy
    OBJECT = 7  # a dataclass or a msgspec.Struct
    ENUM = 8
    FRACTION = 9
    CAPS = 10
    TYPE = 11
    INTEGER = 12  # of more than 64 bits, as text


SEQUENCES: dict[type, Tag] = {
    tuple: Tag.TUPLE, list: Tag.LIST, set: Tag.SET, frozenset: Tag.FROZEN_SET,
}  # fmt: skip
MAKERS: dict[Tag, Callable[[Iterable[Any]], Any]] = {tag: kind for kind, tag in SEQUENCES.items()}


def type_path(kind: type) -> str:
    """The module and name of a class, "module:Name"."""
    return f"{kind.__module__}:{kind.__qualname__}"


def field_names(kind: type) -> tuple[str, ...] | None:
    """The fields that make an object of a dataclass or struct; None for other classes."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind) if field.init)
    if issubclass(kind, msgspec.Struct):
        return kind.__struct_fields__
    return None


class ValueEncoder:
    """Turns values into plain structures."""

    def __init__(self) -> None:
        self._objects: dict[type, tuple[str, tuple[str, ...]]] = {}

    def encode(self, value: Any) -> Any:
        """The plain structure of a value.

        Raises:
            CannotCross: it is, or holds, an object of another type; the error names the type.
        """
        kind = type(value)
        if kind in PLAIN:
            is_long = kind is int and not -(2**63) <= value < 2**64
            return [Tag.INTEGER, str(value)] if is_long else value
        known = self._objects.get(kind)
        if known is not None:
            path, names = known
            return [Tag.OBJECT, path, *(self.encode(getattr(value, name)) for name in names)]
        if kind in SEQUENCES:
            return [SEQUENCES[kind], *map(self.encode, value)]
        if isinstance(value, enum.Enum):
            return [Tag.ENUM, type_path(kind), self.encode(value.value)]
        return self._encode_rare(kind, value)

    def _encode_rare(self, kind: type, value: Any) -> Any:
        if kind is dict or kind is MappingProxyType:
            return [Tag.MAPPING, *(self.encode(item) for pair in value.items() for item in pair)]
        if kind is Fraction:
            return [Tag.FRACTION, self.encode(value.numerator), self.encode(value.denominator)]
        if kind is Caps:
            return [Tag.CAPS, str(value)]
        if isinstance(value, type):
            return [Tag.TYPE, type_path(value)]
        names = field_names(kind)
        if names is not None:
            self._objects[kind] = type_path(kind), names
            return self.encode(value)
        if "numpy" in sys.modules:
            found = _encode_numpy(value)
            if found is not None:
                return found
        raise CannotCross(
            f"{type_path(kind)} cannot reach another process: make it a dataclass of numbers, texts, arrays "
            "and such dataclasses, or put the elements that share it into one bin"
        )


def _encode_numpy(value: Any) -> Any:
    import numpy as np

    if isinstance(value, np.generic) and not value.dtype.hasobject and value.dtype.names is None:
        return [Tag.SCALAR, value.dtype.str, value.tobytes()]
    if type(value) is not np.ndarray or value.dtype.hasobject or value.dtype.names is not None:
        return None
    order: Literal["C", "F"] = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
    return [
        Tag.ARRAY, value.dtype.str, list(value.shape), order, value.flags.writeable, value.tobytes(order),
    ]  # fmt: skip


class ValueDecoder:
    """Turns plain structures back into values.

    Args:
        packages: top-level packages whose dataclasses, structs and enumerations may be made; others are
            refused, so that the other process cannot have any code imported.
    """

    def __init__(self, packages: Iterable[str] = ()) -> None:
        self._packages = frozenset({"streamkit", *packages})
        self._type = functools.cache(self._find)

    def decode(self, item: Any) -> Any:
        """The value of a plain structure.

        Raises:
            CannotCross: it names a type that may not be made.
            ValueError: it is no such structure, and neither are its parts.
        """
        if type(item) is not list:
            return item
        try:
            return self._decode_list(Tag(item[0]), item)
        except (IndexError, TypeError, KeyError, ZeroDivisionError) as error:
            raise ValueError(f"the other process has sent a value that cannot be read: {error}") from error

    def _decode_list(self, tag: Tag, item: list[Any]) -> Any:
        if tag is Tag.OBJECT:
            kind, names = self._type(item[1])
            return kind(**dict(zip(names, map(self.decode, item[2:]), strict=True)))
        if tag in MAKERS:
            return MAKERS[tag](map(self.decode, item[1:]))
        if tag is Tag.ARRAY:
            return _decode_array(*item[1:])
        if tag is Tag.SCALAR:
            return _decode_array(item[1], [], "C", False, item[2])[()]
        if tag is Tag.ENUM:
            return self._type(item[1])[0](self.decode(item[2]))
        if tag is Tag.MAPPING:
            values = [self.decode(part) for part in item[1:]]
            return dict(zip(values[::2], values[1::2], strict=True))
        if tag is Tag.TYPE:
            return self._type(item[1])[0]
        if tag is Tag.FRACTION:
            return Fraction(self.decode(item[1]), self.decode(item[2]))
        return int(item[1]) if tag is Tag.INTEGER else Caps(item[1])

    def find_type(self, path: str) -> type:
        """The class at a path, "module:Name"; raises `CannotCross`."""
        return self._type(path)[0]

    def _find(self, path: str) -> tuple[type, tuple[str, ...]]:
        """The class at a path, and the fields that make an object of it."""
        module, _, name = path.partition(":")
        if module.partition(".")[0] not in self._packages:
            raise CannotCross(
                f"{path} cannot come from another process: no element of the pipeline is from its package"
            )
        try:
            kind = operator.attrgetter(name)(importlib.import_module(module))
        except (ImportError, AttributeError) as error:
            raise CannotCross(f"{path} cannot come from another process: {error}") from None
        names = field_names(kind) if isinstance(kind, type) else None
        is_protocol = getattr(kind, "_is_protocol", False)
        if names is None and not is_protocol and not (isinstance(kind, type) and issubclass(kind, enum.Enum)):
            raise CannotCross(f"{path} cannot come from another process: it is no dataclass")
        return kind, names or ()


def _decode_array(dtype: str, shape: list[int], order: str, is_writable: bool, data: bytes) -> NDArray[Any]:
    import numpy as np

    kind = np.dtype(dtype)
    if kind.hasobject:
        raise CannotCross("arrays of Python objects cannot come from another process")
    flat: NDArray[Any] = np.frombuffer(bytearray(data) if is_writable else data, kind)
    return flat.reshape(shape, order="F" if order == "F" else "C")


def encode_mapping(values: Mapping[str, Any]) -> dict[str, Any]:
    """The plain structures of named values, such as the fields of a message; text for what has no form."""
    encoder = ValueEncoder()
    found = {}
    for name, value in values.items():
        try:
            found[name] = encoder.encode(value)
        except CannotCross:
            found[name] = str(value)
    return found
