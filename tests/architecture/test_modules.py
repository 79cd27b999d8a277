"""Module sizes, names and docstrings."""

import ast
import threading
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


def test_threads_leave_the_names_of_their_base_class_alone() -> None:
    """In Python 3.13 `Thread` got a `_handle`, and a method of that name ended every process bin."""
    of_later_versions = {"_handle", "_context", "_os_thread_handle"}  # 3.13 and 3.14
    thread = threading.Thread()
    names = {name for name in {*dir(thread), *vars(thread)} if not name.startswith("__")} | of_later_versions
    names -= {"run"}  # meant to be overridden
    overridden = {
        f"{node.name}.{name}"
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and any("Thread" in ast.unparse(base) for base in node.bases)
        for name in _own_names(node) & names
    }
    assert overridden == set()


def _own_names(node: ast.ClassDef) -> set[str]:
    """Methods of a class, and attributes that they set."""
    inner = list(ast.walk(node))
    methods = {item.name for item in inner if isinstance(item, ast.FunctionDef)}
    return methods | {
        item.attr for item in inner if isinstance(item, ast.Attribute) and isinstance(item.ctx, ast.Store)
    }
