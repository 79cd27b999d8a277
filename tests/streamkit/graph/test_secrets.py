"""Secrets in descriptions."""

import time
from collections.abc import Callable

import pytest

from streamkit import Element, Pipeline, Property
from streamkit.errors import DescriptionError, Place
from streamkit.graph.description_text import secret_assignments
from streamkit.masking import mask_secrets

Register = Callable[..., None]


class Vault(Element):
    """Has a secret property."""

    sink = "ANY"
    word: str = Property("", secret=True)


def test_secrets_are_found_by_declaration_and_by_name(register: Register) -> None:
    """Also where the text does not fit the grammar, and where the element is unknown."""
    register(vault=Vault)
    text = ') vault word=w1 other=x ! nosuch user-pw = "p w" word=seen ! vault a::access-token=t ;'
    assert secret_assignments(text) == ("word=w1", 'user-pw = "p w"', "a::access-token=t")


def test_credentials_of_addresses_are_masked() -> None:
    """Up to the last @ before the path."""
    assert mask_secrets("a rtsp://me:p@ss@cam/x b http://h/@x y://u@h") == (
        "a rtsp://***@cam/x b http://h/@x y://***@h"
    )


def test_the_pointed_line_keeps_its_columns() -> None:
    """Secrets become stars, one for each character, so that the caret still stands below the fault."""
    text = "x password=hunter2 location=rtsp://me:pw@h nosuch"
    error = DescriptionError("syntax", "no", Place(1, 44, 6))
    error.secrets = ("password=hunter2",)
    assert error.pointed(text).split("\n")[1:] == [
        "    x password=******* location=rtsp://*****@h nosuch",
        "                                               ^^^^^^",
    ]


def test_the_search_for_secrets_ends_with_the_last_token() -> None:
    """A text of a million faults is refused at its limit of tokens, and not read to its end for secrets."""
    text = f"x password=a {'|' * 900_000} password=b"
    began = time.process_time()
    assert secret_assignments(text) == ("password=a",)
    assert time.process_time() - began < 5.0


def test_thousands_of_unknown_elements_are_looked_up_without_hints(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hint is worked out for the fault alone: 20 000 words with assignments would else take minutes."""
    asked: list[str] = []
    monkeypatch.setattr("difflib.get_close_matches", lambda word, *_, **__: asked.append(word) or [])
    text = " ! ".join(f"nosuchelement{number} caps=1" for number in range(5000))
    assert secret_assignments(text) == ()
    assert asked == []
    with pytest.raises(DescriptionError, match="no element"):
        Pipeline.parse(text)
    assert len(asked) == 1
