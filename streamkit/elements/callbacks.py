"""Callbacks: what an element calls in its streaming thread when something happens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Callbacks:
    """A list of callables; called with a callable it adds it: `element.on_handoff(function)`.

    They stand for GStreamer's signals, and run in the thread that streams: keep them short.
    """

    __slots__ = ("_callables",)

    def __init__(self) -> None:
        self._callables: tuple[Callable[..., Any], ...] = ()

    def __call__(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Adds a callable; it may be used as a decorator."""
        self._callables = (*self._callables, function)
        return function

    def __bool__(self) -> bool:
        return bool(self._callables)

    def remove(self, function: Callable[..., Any]) -> None:
        """Takes a callable away; one that is not there is left alone."""
        self._callables = tuple(known for known in self._callables if known != function)

    def emit(self, *args: object) -> None:
        """Calls each, in the order in which they were added."""
        for function in self._callables:
            function(*args)
