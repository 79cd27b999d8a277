"""Finds secrets in a description: values of properties that are secret by declaration or by name."""

from __future__ import annotations

import itertools
import re

from streamkit.element.registry import available_elements, element_class
from streamkit.errors import DescriptionError, PluginBroken
from streamkit.graph.tokens import TOKEN_LIMIT, DescriptionLexer
from streamkit.masking import MASK, credential_spans, is_secret_name

MIN_PIECE = 3  # shorter ones occur in too many words of an error


def conceal(error: DescriptionError, text: str) -> None:
    """Masks the secrets of a text in an error about it.

    A password with blanks is parsed as several words, which an error may name as elements.
    """
    pieces = {
        piece
        for start, end in credential_spans(text)
        if re.search(r"\s", text[start:end])
        for piece in re.split(r"[\s:@/!]+", text[start:end])
        if len(piece) >= MIN_PIECE
    }
    if pieces:
        words = re.compile("|".join(re.escape(piece) for piece in sorted(pieces, key=len, reverse=True)))
        error.message, error.hint = words.sub(MASK, error.message), words.sub(MASK, error.hint)
        error.args = (error.message + (f"; {error.hint}" if error.hint else ""),)
    error.secrets = secret_assignments(text)


def secret_assignments(text: str) -> tuple[str, ...]:
    """The assignments of a text whose values are secret, as written."""
    found: list[str] = []
    factory = ""
    for token in itertools.islice(DescriptionLexer(None).lex(text), TOKEN_LIMIT):
        if token.type == "IDENTIFIER":
            factory = str(token)
        elif token.type == "ASSIGNMENT":
            name = str(token).partition("=")[0].strip().rpartition("::")[2]
            if is_secret_name(name) or _is_declared_secret(factory, name):
                found.append(str(token))
    return tuple(found)


def _is_declared_secret(factory: str, name: str) -> bool:
    if factory not in available_elements():  # no search for a similar name: a text may have thousands
        return False
    try:
        declaration = element_class(factory).declaration_of(name)
    except PluginBroken:
        return False
    return declaration is not None and declaration.secret
