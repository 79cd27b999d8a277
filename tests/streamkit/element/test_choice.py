"""Choices: words with numbers and labels."""

from streamkit import Choice


class Size(Choice):
    """Begins at one, leaves a gap."""

    EMPTY = "empty", 1, "Empty frames"
    FIXED = "fixed"
    RANDOM = "random", 5


def test_default_numbers_and_labels_of_members() -> None:
    """The number after the previous one; the word as label."""
    assert [(member.value, member.number, member.label) for member in Size] == [
        ("empty", 1, "Empty frames"), ("fixed", 2, "fixed"), ("random", 5, "random"),
    ]  # fmt: skip
    assert Size("fixed") is Size.FIXED
    assert f"{Size.EMPTY}" == "empty"
