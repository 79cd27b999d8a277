"""Choices: words with numbers and labels."""

from streamkit import Choice


class Size(Choice):
    """Begins at one, leaves a gap."""

    EMPTY = "empty", 1, "Empty frames"
    FIXED = "fixed"
    RANDOM = "random", 5


def test_members_count_on_from_the_one_before() -> None:
    """A label left out is the word; a member is its word."""
    assert [(member.value, member.number, member.label) for member in Size] == [
        ("empty", 1, "Empty frames"), ("fixed", 2, "fixed"), ("random", 5, "random"),
    ]  # fmt: skip
    assert Size("fixed") is Size.FIXED
    assert f"{Size.EMPTY}" == "empty"
