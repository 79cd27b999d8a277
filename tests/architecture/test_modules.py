"""Module sizes, names and docstrings."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LONGEST = 350
NAMES_THAT_SAY_NOTHING = {"utils", "util", "helpers", "helper", "common", "misc", "manager", "managers"}
FILES = sorted(path for folder in ("streamkit", "plugins") for path in (ROOT / folder).rglob("*.py"))


def test_there_are_modules_to_check() -> None:
    """The search finds the engine and the plugins."""
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == {"streamkit", "plugins"}


def test_no_module_is_too_long() -> None:
    """No module has more than 350 lines."""
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES
    }
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}


def test_no_module_has_a_meaningless_name() -> None:
    """No module or folder is called utils, helpers, common, misc or manager."""
    named = {part for path in FILES for part in path.relative_to(ROOT).with_suffix("").parts}
    assert not named & NAMES_THAT_SAY_NOTHING


@pytest.mark.parametrize("folder", ["streamkit", "plugins"])
def test_every_module_has_a_docstring(folder: str) -> None:
    """The first line of each module is its docstring."""
    silent = [
        str(path.relative_to(ROOT))
        for path in FILES
        if path.relative_to(ROOT).parts[0] == folder
        and not path.read_text(encoding="utf-8").lstrip().startswith(('"""', 'r"""'))
    ]
    assert not silent
