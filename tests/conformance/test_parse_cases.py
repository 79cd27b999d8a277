"""GStreamer's own parse cases: the same graph, or the same error, as gst-launch gives.

Each case is built; elements are compared with their bins, links pad by pad, and the properties that the
case names. Where streamkit departs on purpose, DEPARTURES says what it does instead, and why stands in
docs/decisions/004-departures-from-gst-launch.md.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from streamkit.cli.description import join_arguments
from streamkit.element.registry import available_elements
from streamkit.errors import DescriptionError
from streamkit.graph.bins import BIN_CLASSES, Bin
from streamkit.graph.build import build
from streamkit.graph.graph import Graph

# What streamkit does instead, by case: the code of its error, or "ok"; and the row of the page that says so.
DEPARTURES: dict[str, tuple[str, str]] = {
    "mf-1": ("link", "`multifilesrc` outputs bytes"),
    "pl-fail-02": ("no-such-property", "`filesrc` reads blocks"),
    "sl-base-7": ("link", "raw video in about eighty formats"),
    "x-f31": ("link", "a reversed or empty range in caps"),
    "x-f32": ("link", "a reversed or empty range in caps"),
    "x-g15": ("ok", "a single argument that contains a whole description"),
    "x-m18": ("ok", "raw video of another format is an error"),
    "x-q15": ("no-such-property", "`filesrc` reads blocks"),
    "x-q29": ("no-such-property", "`filesrc` reads blocks"),
    "x-q33": ("syntax", "a non-ASCII byte outside a value"),
    "x-v04": ("could-not-set-property", "a value out of range"),
    "x-v45": ("could-not-set-property", "a number too large for an unsigned 32-bit property"),
}
PROPERTY_ERRORS = ("NO_SUCH_PROPERTY", "COULD_NOT_SET_PROPERTY")
NO_TEXT = "filesrc location=" + "a" * 100_000  # of the case whose text is too long to be written down


def cases(shared_folder: Path) -> list[dict[str, Any]]:
    """All parse cases."""
    lines = (shared_folder / "conformance" / "cases.jsonl").read_text(encoding="utf-8").splitlines()
    return [case for case in map(json.loads, lines) if case["kind"] == "parse"]


def text_of(case: dict[str, Any]) -> str:
    """The description of a case as `build` takes it."""
    if case["description"] is None:
        return NO_TEXT
    if case.get("api") == "launchv" and len(case["argv"]) > 1:
        return join_arguments(case["argv"])
    if case.get("api") == "bin" and "no-single-element-bins" not in case.get("flags", []):
        return f"bin.( {case['description']} )"
    return str(case["description"])


def concerns_other_elements(case: dict[str, Any]) -> bool:
    """Whether a case is about an element that is not installed here."""
    known = {*available_elements(), *BIN_CLASSES}
    used = {element["factory"] for element in case.get("elements", [])}
    if case["expect"].get("error_class") in PROPERTY_ERRORS:  # then it is "missing" because it was not made
        used |= set(case.get("missing_elements", []))
    return not used <= known


def outcome(case: dict[str, Any]) -> tuple[str, Graph]:
    """The code of the error or "ok", and the graph."""
    try:
        return "ok", build(text_of(case), {})
    except DescriptionError as error:
        return error.code, Graph()


def expected_outcome(case: dict[str, Any]) -> str:
    """The code that GStreamer's answer stands for."""
    return str(case["expect"].get("error_class", "ok")).lower().replace("_", "-")


class Shape:
    """A graph as the cases write one: paths from the top object, links between paths."""

    def __init__(self, graph: Graph) -> None:
        self._parents = {id(child): group for group in graph.bins for child in group.children}
        members = [*(e for e in graph.elements if e not in graph.inserted), *graph.bins]
        roots = [member for member in members if id(member) not in self._parents]
        self._top = roots[0] if len(roots) == 1 else None
        inside = [m for m in members if not (m is self._top and isinstance(m, Bin))]
        self.elements = {self.path(member): member.factory for member in inside}
        self.settings = {self.path(member): member.properties_set() for member in members}
        self.links = {
            f"{self.path(src.element)}.{src.name} -> {self.path(sink.element)}.{sink.name}"
            for src, sink in graph.links()
        }
        self.ghost_pads = {f"{self.path(group)}.{name}" for group in graph.bins for name in group.ghost_pads}

    def path(self, member: Any) -> str:
        """The names from the top object down."""
        names: list[str] = []
        while member is not None and member is not self._top:
            names.append(member.name)
            member = self._parents.get(id(member))
        return "/".join(reversed(names)) or "."


def differences(case: dict[str, Any]) -> list[str]:
    """What is not as GStreamer has it."""
    code, graph = outcome(case)
    expected = expected_outcome(case)
    if code != expected:
        return [f"{case['id']}: {code}, not {expected}"]
    if code != "ok":
        return []
    shape = Shape(graph)
    wrong = []
    elements = {element["path"]: element["factory"] for element in case["elements"]}
    if shape.elements != elements:
        wrong.append(f"{case['id']}: elements {shape.elements}, not {elements}")
    if shape.links != set(case["links"]):
        wrong.append(f"{case['id']}: links {sorted(shape.links)}, not {case['links']}")
    ghosts = {pad.partition(" => ")[0] for pad in case.get("ghost_pads", []) if not pad.startswith("(top)")}
    if shape.ghost_pads != ghosts:
        wrong.append(f"{case['id']}: ghost pads {sorted(shape.ghost_pads)}, not {sorted(ghosts)}")
    for path, values in case.get("properties", {}).items():
        for name, value in values.items():
            given = shape.settings.get(path, {}).get(name, "unset")
            # Names stand elsewhere; what only GStreamer's objects have is no text.
            is_text = (
                name != "name" and not str(value).startswith("<Gst") and not str(value).endswith("chars)")
            )
            if is_text and given != value:
                wrong.append(f"{case['id']}: {path}.{name} is {given!r}, not {value!r}")
    return wrong


def test_every_case_gives_what_gstreamer_gives(shared_folder: Path) -> None:
    """The same elements, links, ghost pads and properties, or the same first error."""
    wrong = [
        line
        for case in cases(shared_folder)
        if not concerns_other_elements(case) and case["id"] not in DEPARTURES
        for line in differences(case)
    ]
    assert not wrong, "\n".join(wrong)


def test_departures_are_as_documented(shared_folder: Path) -> None:
    """Each does what the table says, and would not pass as GStreamer has it."""
    by_id = {case["id"]: case for case in cases(shared_folder)}
    assert set(DEPARTURES) <= set(by_id)
    found = {name: outcome(by_id[name])[0] for name in DEPARTURES}
    assert found == {name: code for name, (code, _) in DEPARTURES.items()}
    assert all(differences(by_id[name]) for name in DEPARTURES)


def test_few_cases_are_about_other_elements(shared_folder: Path) -> None:
    """Cases are left out by one rule only, and every one of the rest is run."""
    every = cases(shared_folder)
    left_out = [case["id"] for case in every if concerns_other_elements(case)]
    assert len(every) == 268
    assert left_out == ["x-v39", "x-v42"]  # playbin


@pytest.mark.parametrize("name", sorted(DEPARTURES))
def test_departures_are_written_down(name: str) -> None:
    """The page of departures has a row for the case."""
    page = Path(__file__).parents[2] / "docs" / "decisions" / "004-departures-from-gst-launch.md"
    assert f"| {DEPARTURES[name][1]}" in page.read_text(encoding="utf-8")
