"""GStreamer's own cases of caps, structures and values, through `streamkit caps`.

Every case runs; where streamkit departs on purpose, docs/decisions/005-caps.md says why.
"""

from __future__ import annotations

import enum
import json
from collections.abc import Callable
from typing import Any

from typer.testing import CliRunner

from streamkit.cli.main import make_app
from streamkit.element.property_text import value_from_text

Case = dict[str, Any]
RUNNER = CliRunner()
APP = make_app()
GTYPES = {
    "int": "gint", "uint": "guint", "double": "gdouble", "float": "gfloat", "boolean": "gboolean",
    "string": "gchararray", "fraction": "GstFraction", "bitmask": "GstBitmask", "flagset": "GstFlagSet",
}  # fmt: skip


class SeekFlags(enum.Flag):
    """A flags type of the size of GStreamer's, for what the cases say of flags."""

    FLUSH = 1
    ACCURATE = 2
    KEY_UNIT = 4
    SEGMENT = 8
    TRICKMODE = 16


def run(*arguments: str) -> dict[str, Any] | None:
    """What the command prints; None where it says that a text cannot be read."""
    done = RUNNER.invoke(APP, ["caps", *arguments])
    if done.exit_code == 2:
        error = json.loads(done.stderr)["error"]
        assert error["code"] == "syntax", error
        return None
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def asked(*arguments: str) -> bool:
    """The answer of a question."""
    found = run(*arguments)
    assert found is not None, arguments
    return bool(found["result"])


def check_caps(found: dict[str, Any] | None, case: Case) -> str | None:
    """What the caps of a result should have been, or None where they are right."""
    expect, text = case["expect"], (found or {}).get("caps", "")
    if found is None:
        return "caps"
    for name in ("empty", "any", "size"):
        if name in expect and found[name] != expect[name]:
            return f"{name} {expect[name]}"
    if "equal" in expect and not asked("equal", text, expect["equal"]):
        return f"equal to {expect['equal']}"
    if "strict" in expect and not asked("strictly-equal", text, expect["strict"]):
        return f"strictly equal to {expect['strict']}"
    if "string" in case["gst"] and text != case["gst"]["string"]:
        return str(case["gst"]["string"])
    return None


def of_caps(*operation: str) -> Callable[[Case], str | None]:
    """A check of an operation that gives caps."""
    return lambda case: check_caps(run(*operation, *case["args"]), case)


def both_orders(case: Case) -> str | None:
    """An intersection that must hold whichever side comes first."""
    one, other = case["args"]
    if not asked("equal", run("intersect", one, other)["caps"], run("intersect", other, one)["caps"]):  # type: ignore[index]
        return "the same in both orders"
    return of_caps("intersect")(case)


def union_simplified(case: Case) -> str | None:
    """A union in as few structures as may be."""
    union = run("union", *case["args"])
    assert union is not None
    return check_caps(run("simplify", union["caps"]), case)


def relation(case: Case) -> str | None:
    """Which of two caps lies within the other, and whether they are equal."""
    found = run("relate", *case["args"])
    assert found is not None
    names = {"a_in_b": "subset", "b_in_a": "superset", "strictly": "strictly_equal"}
    wrong = [name for name, value in case["expect"].items() if found[names.get(name, name)] is not value]
    return f"otherwise: {wrong}" if wrong else None


def fixedness(case: Case) -> str | None:
    """Whether caps are fixed."""
    right = asked("is-fixed", *case["args"]) is case["expect"]["fixed"]
    return None if right else f"fixed: {case['expect']['fixed']}"


def first_field(case: Case) -> str | None:
    """Type and value of the first field."""
    found = run("parse", *case["args"])
    assert found is not None
    field = next(iter(found["structures"][0]["fields"].values()))
    right = [GTYPES.get(field["type"], field["type"]), field["value"]] == [
        case["expect"]["type"], case["expect"]["value"],
    ]  # fmt: skip
    return None if right else f"{case['expect']}, not {field}"


def readable(case: Case) -> str | None:
    """Whether the text can be read; what is read is written so that it reads as the same."""
    found = run("parse", *case["args"])
    if (found is not None) is not case["expect"]["ok"]:
        return f"readable: {case['expect']['ok']}"
    return None if found is None or run("parse", found["caps"]) == found else "the same text again"


def value(case: Case) -> str | None:
    """A text read as a value of a type."""
    kind, text = case["args"]
    expect = case["expect"]
    if kind == "GstSeekFlags":
        return flags(text, expect)
    found = run("deserialize", kind, text)
    if expect.get("ok") is False:
        return "a refusal" if found is not None else None
    return None if found is not None and found["value"] == expect["value"] else f"{expect}, not {found}"


def flags(text: str, expect: dict[str, Any]) -> str | None:
    """Flags are a type of properties; names there are words, without the prefix of C constants."""
    try:
        found = value_from_text(
            SeekFlags, text.replace("GST_SEEK_FLAG_NONE", "0").replace("GST_SEEK_FLAG_", "")
        )
    except ValueError:
        return None if expect.get("ok") is False else str(expect)
    return None if found.value == expect.get("value") else str(expect)


def of_values(operation: str) -> Callable[[Case], str | None]:
    """A check of an operation on two values."""

    def check(case: Case) -> str | None:
        found = run(operation, *case["args"])
        assert found is not None
        wanted = case["expect"]["result"]
        if found["result"] is None or wanted is None:
            return None if found["result"] is wanted else str(wanted)
        return None if asked("value-equal", found["result"], wanted) else str(wanted)

    return check


def list_size(case: Case) -> str | None:
    """How many members a list has, or that it is none."""
    found = run("value", *case["args"])
    size = None if found is None else len(found["value"]["list"])
    return None if size == case["expect"]["size"] else str(case["expect"]["size"])


CHECKS: dict[str, Callable[[Case], str | None]] = {
    "merge": of_caps("union"),
    "merge_simplify": union_simplified,
    "intersect": of_caps("intersect"),
    "intersect_sym": both_orders,
    "intersect_zigzag": of_caps("intersect", "--mode", "zigzag"),
    "intersect_first": of_caps("intersect", "--mode", "first"),
    "normalize": of_caps("normalize"),
    "simplify": of_caps("simplify"),
    "truncate": of_caps("truncate"),
    "fixate": of_caps("fixate"),
    "is_fixed": fixedness,
    "subset": relation,
    "st_subset": relation,
    "relate": relation,
    "equality": relation,
    "field0": first_field,
    "structure": readable,
    "st_roundtrip_nested": readable,
    "stepped": readable,
    "deserialize": value,
    "value_union": of_values("value-union"),
    "value_inter": of_values("value-intersect"),
    "list_size": list_size,
}


def test_caps_structures_and_values_are_gstreamers(conformance_cases: list[Case]) -> None:
    """Every case gives the result, and the text, that GStreamer gives."""
    cases = [case for case in conformance_cases if case["kind"] in ("caps", "structure", "value")]
    assert len(cases) > 100
    wrong = {case["id"]: fault for case in cases if (fault := CHECKS[case["op"]](case)) is not None}
    assert wrong == {}
