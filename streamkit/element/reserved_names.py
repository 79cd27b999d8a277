"""Names that the base classes of elements use for themselves, and that a property must not have."""

from __future__ import annotations

import dis
import functools
import inspect
from itertools import pairwise
from types import FunctionType

ENGINE = "streamkit."
NAME = "name"  # in a description it names the element


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
        is_engine = f"{base.__module__}.".startswith(ENGINE)
        if is_engine and (isinstance(found, property) or attribute in _own_attributes(base)):
            return f"the attribute {base.__name__}.{attribute}"
    return ""


@functools.cache
def _own_attributes(base: type) -> frozenset[str]:
    """The class variables of a class of the engine, and what its methods set on `self`."""
    annotations = inspect.get_annotations(base).items()
    variables = {name for name, annotation in annotations if str(annotation).startswith("ClassVar[")}
    methods = (member for member in vars(base).values() if isinstance(member, FunctionType))
    stored = (_stored_on_self(method) for method in methods)
    return frozenset(variables.union(*stored))


def _stored_on_self(method: FunctionType) -> set[str]:
    """The attributes in assignments to `self`; an instruction may load several names, that one last."""
    lines = pairwise(dis.get_instructions(method))
    stored = ((before.argval, str(line.argval)) for before, line in lines if line.opname == "STORE_ATTR")
    return {
        name for loaded, name in stored if (loaded[-1] if isinstance(loaded, tuple) else loaded) == "self"
    }
