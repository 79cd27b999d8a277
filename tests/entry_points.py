"""Entry points of one test alone."""

import importlib.metadata
import sys
import types
from collections.abc import Callable

import pytest

AddEntryPoint = Callable[[str, str, object], None]


def adding_entry_points(monkeypatch: pytest.MonkeyPatch, module_name: str) -> AddEntryPoint:
    """Makes a function that adds an entry point, before all installed ones, until the test ends.

    Args:
        monkeypatch: of the test.
        module_name: of a module that the added objects get.

    Returns:
        Takes group, name, and the object or a text "module:object".
    """
    module = types.ModuleType(module_name)
    monkeypatch.setitem(sys.modules, module_name, module)
    installed = importlib.metadata.entry_points
    added: list[importlib.metadata.EntryPoint] = []

    def with_added(**selection: str) -> list[importlib.metadata.EntryPoint]:
        mine = [entry for entry in added if entry.group == selection.get("group", entry.group)]
        return [*mine, *installed(**selection)]

    def add(group: str, name: str, found: object) -> None:
        setattr(module, name, found)
        target = found if isinstance(found, str) else f"{module_name}:{name}"
        added.append(importlib.metadata.EntryPoint(name, target, group))

    monkeypatch.setattr(importlib.metadata, "entry_points", with_added)
    return add
