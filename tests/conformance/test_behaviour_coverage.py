"""Every line of behaviour.md is a test, or a departure that is told."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINE = re.compile(r"^- \*\*([a-z0-9-]+)\*\*", re.MULTILINE)


def test_every_behaviour_is_tested_or_told_as_a_departure(shared_folder: Path) -> None:
    """The line's name stands in a test's docstring or in a table of departures in docs/decisions."""
    names = LINE.findall((shared_folder / "conformance" / "behaviour.md").read_text(encoding="utf-8"))
    assert len(names) > 150
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]
    texts += [path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "decisions").glob("*.md")]
    told = set(re.findall(r"(?<![\w-])[a-z]+[0-9]*(?:-[a-z0-9]+)+(?![\w-])", "\n".join(texts)))
    assert [name for name in names if name not in told] == []
