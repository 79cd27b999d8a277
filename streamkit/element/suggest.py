"""Did-you-mean hints."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint with the nearest known word, or "" where none is near."""
    import difflib

    by_lower_case = {name.lower(): name for name in known}
    nearest = difflib.get_close_matches(word.lower(), list(by_lower_case), n=1, cutoff=0.6)
    return f'did you mean "{by_lower_case[nearest[0]]}"?' if nearest else ""
