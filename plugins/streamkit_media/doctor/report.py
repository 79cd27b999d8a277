"""Checks with verdicts, and how they are shown."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from streamkit import mask_secrets

Verdict = enum.StrEnum("Verdict", "GOOD NOTE BAD")


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes:
        name: what was looked at.
        verdict: good, note (worth knowing) or bad.
        text: what was found, for people, secrets masked; where it is not good, also what to do.
        facts: the same for programs.
    """

    name: str
    verdict: Verdict
    text: str
    facts: dict[str, Any]


def good(name: str, text: str, **facts: Any) -> Check:
    """A check that found nothing wrong."""
    return Check(name, Verdict.GOOD, mask_secrets(text), facts)


def note(name: str, text: str, **facts: Any) -> Check:
    """A check that found something worth knowing."""
    return Check(name, Verdict.NOTE, mask_secrets(text), facts)


def bad(name: str, text: str, **facts: Any) -> Check:
    """A check that says why the stream cannot be used."""
    return Check(name, Verdict.BAD, mask_secrets(text), facts)


def good_if(is_good: bool, name: str, text: str, **facts: Any) -> Check:
    """A good check, else a note."""
    return (good if is_good else note)(name, text, **facts)


def is_usable(checks: Iterable[Check]) -> bool:
    """Whether none of the checks is bad."""
    return all(check.verdict is not Verdict.BAD for check in checks)


@dataclass(frozen=True, slots=True)
class Report:
    """All checks of one stream.

    Attributes:
        location: without passwords.
        checks: in the order they were made.
        pipeline: a line to begin with; "" where the stream cannot be used.
    """

    location: str
    checks: tuple[Check, ...]
    pipeline: str

    @property
    def is_usable(self) -> bool:
        """Whether nothing is bad."""
        return is_usable(self.checks)

    def as_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {"usable": self.is_usable, **asdict(self)}

    def as_text(self) -> str:
        """The report for people."""
        width = max((len(check.name) for check in self.checks), default=0)
        lines = [f"{check.verdict:<4}  {check.name:<{width}}  {check.text}" for check in self.checks]
        if self.pipeline:
            lines += ["", f"  {self.pipeline}"]
        return "\n".join(lines)
