"""`pytest --process-of identity`: each element of that type in a description runs in a process of its own.

A test is skipped if it reaches into such an element, brings elements or a clock that other processes do not
have, or puts the element where no process can be.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import pytest

from streamkit import DescriptionError, Pipeline
from streamkit.element.registry import available_elements
from streamkit.graph import build as build_module
from streamkit.graph.description_text import DescriptionLexer
from streamkit.graph.graph import Graph

OF_A_TEST = "elements_of_a_test"


def in_processes(text: str, factory: str) -> str:
    """The description with each element of a type, and its properties, in a bin with a process."""
    tokens = list(DescriptionLexer(None).lex(text))
    for index in reversed(range(len(tokens))):
        if tokens[index].type == "IDENTIFIER" and tokens[index] == factory:
            last = index
            while last + 1 < len(tokens) and tokens[last + 1].type in ("ASSIGNMENT", "PRESET"):
                last += 1
            begin, end = tokens[index].start_pos or 0, tokens[last].end_pos or 0
            text = f"{text[:begin]}( process=true {text[begin:end]} ){text[end:]}"
    return text


def use_processes(factory: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes every pipeline of a test run the elements of a type in processes."""
    build, begin, find = build_module.build, Pipeline.__init__, Pipeline.__getitem__

    def build_in_processes(text: str, variables: Mapping[str, str], taken: Container[str] = ()) -> Graph:
        graph = build(text, variables, taken)
        if taken or all(element.factory != factory for element in graph.elements):  # branches have none
            return graph
        entries = [available_elements().get(element.factory) for element in graph.elements]
        if any(entry is not None and entry.target.startswith(OF_A_TEST) for entry in entries):
            pytest.skip("an element of this test is in no package")
        try:
            return build(in_processes(text, factory), variables)
        except DescriptionError as error:
            pytest.skip(f"cannot be in a process: {error}")

    def begin_without_clock(self: Pipeline, graph: Graph, clock: Any = None, *rest: Any, **more: Any) -> None:
        if clock is not None and graph.processes:
            pytest.skip("this test has a clock of its own")
        begin(self, graph, clock, *rest, **more)

    def find_in_main(self: Pipeline, name: str) -> Any:
        element = find(self, name)
        if element in self.graph.homes:
            pytest.skip(f"this test reaches into {name}")
        return element

    monkeypatch.setattr(build_module, "build", build_in_processes)
    monkeypatch.setattr(Pipeline, "__init__", begin_without_clock)
    monkeypatch.setattr(Pipeline, "__getitem__", find_in_main)
