"""What a line is can be seen from its colour; NO_COLOR leaves it out."""

import pytest

from streamkit.output.colour import coloured


def test_the_first_word_and_carets_are_coloured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other words and the layout stay."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    text = "good  size  an error: none\n    fakesnk\n    ^^^^^^^\n\nerror: none"
    assert coloured(text) == (
        "\x1b[32mgood\x1b[0m  size  an error: none\n    fakesnk\n    \x1b[31m^^^^^^^\x1b[0m\n\n"
        "\x1b[31merror:\x1b[0m none"
    )
    monkeypatch.setenv("NO_COLOR", "1")
    assert coloured(text) == text
