"""Fixtures for tests of the engine: elements that exist only in a test."""

import importlib.metadata
import sys
import types
from collections.abc import Callable, Iterator

import pytest

from streamkit import Element
from streamkit.element import registry

MODULE = "elements_of_a_test"
Register = Callable[..., None]


def _forget() -> None:
    registry.installed_elements.cache_clear()
    registry.element_class.cache_clear()


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Iterator[Register]:
    """Makes classes usable in descriptions, `register(name=Class)`: in this test only, before all others."""
    module = types.ModuleType(MODULE)
    monkeypatch.setitem(sys.modules, MODULE, module)
    entry_points = importlib.metadata.entry_points
    added: list[importlib.metadata.EntryPoint] = []

    def with_added(**selection: str) -> list[importlib.metadata.EntryPoint]:
        mine = [entry for entry in added if entry.group == selection.get("group", entry.group)]
        return [*mine, *entry_points(**selection)]

    def add(**classes: type[Element] | str) -> None:
        for name, found in classes.items():
            target = found
            if not isinstance(found, str):
                setattr(module, name, found)
                target = f"{MODULE}:{name}"
            added.append(importlib.metadata.EntryPoint(name, str(target), registry.GROUP))
        _forget()

    monkeypatch.setattr(importlib.metadata, "entry_points", with_added)
    yield add
    _forget()
