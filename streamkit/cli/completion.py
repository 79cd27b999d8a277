"""What a shell offers for a word that is not complete: elements, properties and values of a description."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from streamkit.errors import DescriptionError, PluginBroken

if TYPE_CHECKING:
    from streamkit.element.base import Element

LINKS = frozenset("!(.")  # an element comes after these
ELEMENT = re.compile(r"[a-z][\w-]*")


def complete_element(incomplete: str) -> list[str]:
    """Names of elements that begin with a word."""
    from streamkit.element.registry import available_elements

    return _beginning_with(available_elements(), incomplete)


def complete_description(words: Sequence[str], incomplete: str, *, in_quotes: bool = False) -> list[str]:
    """The ways to complete the last word of a description.

    Args:
        words: of the shell, before the last one.
        incomplete: the last word of the shell, with blanks where the description is in quotes.
        in_quotes: whether it is; one with blanks always is.

    Returns:
        The last word of the shell with its last part complete: an element after a link or at the beginning,
        a property after an element, a value of an enumeration or bool after `=`. In quotes, a single one is
        offered twice, the second time with a link: a shell closes the quotes after the only way to complete.
    """
    kept, blank, last = incomplete.rpartition(" ")
    words = [*words, *kept.split()]
    name, equals, value = last.partition("=")
    if len(words) > 1 and words[-1] == "=":  # bash separates `name=value` into three words
        found = _values(_element_of(words[:-2]), words[-2], last)
    elif equals:
        found = [f"{name}={word}" for word in _values(_element_of(words), name, value)]
    elif not words or words[-1][-1:] in LINKS:
        found = complete_element(last)
    else:
        found = _beginning_with(_properties(_element_of(words)), last)
    if (blank or in_quotes) and len(found) == 1:
        found.append(f"{found[0]}VALUE" if found[0].endswith("=") else f"{found[0]} !")
    return [f"{kept}{blank}{word}" for word in found]


def has_open_quote(line: str) -> bool:
    """Whether a line of the shell ends in quotes."""
    return any(line.count(mark) % 2 for mark in "\"'")


def _element_of(words: Sequence[str]) -> str:
    """The last word that is an element's name; "" if there is none."""
    parts = ["", *words, ""]
    for before, word, after in reversed(list(zip(parts, parts[1:], parts[2:], strict=False))):
        if "=" not in (before, after) and ELEMENT.fullmatch(word):
            return word
    return ""


def _class_of(element: str) -> type[Element] | None:
    from streamkit.element.registry import element_class

    try:
        return element_class(element)
    except (DescriptionError, PluginBroken):
        return None


def _properties(element: str) -> list[str]:
    found = _class_of(element)
    declared = [] if found is None else [item.spelling for item in found.properties.values()]
    return [f"{name}=" for name in ("name", *declared)] if element else []


def _values(element: str, name: str, value: str) -> list[str]:
    found = _class_of(element)
    declaration = None if found is None else found.declaration_of(name)
    if declaration is None:
        return []
    return _beginning_with(("true", "false") if declaration.kind is bool else declaration.choices, value)


def _beginning_with(words: Iterable[str], start: str) -> list[str]:
    return [word for word in words if word.startswith(start)]
