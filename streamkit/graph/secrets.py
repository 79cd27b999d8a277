"""Finds what must not be shown with a text: values of properties that are declared secret, or look so."""

from __future__ import annotations

import re

from streamkit.element.registry import element_class
from streamkit.errors import DescriptionError, PluginBroken
from streamkit.graph.tokens import DescriptionLexer

LOOKS_SECRET = re.compile(
    r"passw|passphrase|secret|token|credential|user-?pw|api-?key|private-?key", re.IGNORECASE
)


def secret_assignments(text: str) -> tuple[str, ...]:
    """The assignments of a text whose values are secret, as written."""
    found: list[str] = []
    factory = ""
    for token in DescriptionLexer(None).lex(text):
        if token.type == "IDENTIFIER":
            factory = str(token)
        elif token.type == "ASSIGNMENT":
            name = str(token).partition("=")[0].strip().rpartition("::")[2]
            if LOOKS_SECRET.search(name) or _is_declared_secret(factory, name):
                found.append(str(token))
    return tuple(found)


def _is_declared_secret(factory: str, name: str) -> bool:
    try:
        declaration = element_class(factory).properties.get(name.replace("-", "_"))
    except (DescriptionError, PluginBroken):
        return False
    return declaration is not None and declaration.secret
