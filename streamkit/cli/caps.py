"""`streamkit caps`: computes with caps and prints the result, as JSON for programs."""

from __future__ import annotations

import functools
import json
import operator
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from fractions import Fraction
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand

from streamkit.cli.commands import parsed_by
from streamkit.cli.description import Description, fail_description
from streamkit.cli.stderr import USAGE_EXIT
from streamkit.errors import CapsSyntax, CapsTooLarge, DescriptionError, Place
from streamkit.flow.caps import Caps, Structure, read_value
from streamkit.flow.caps_algebra import intersect_values, is_subset_value, values_equal
from streamkit.flow.caps_simplify import unite_values
from streamkit.flow.caps_text import READERS, TYPES
from streamkit.flow.caps_values import (
    FlagSet,
    IntRange,
    NullText,
    Range,
    Value,
    ValueArray,
    ValueList,
    type_name,
    write_plain,
)


class CapsCommand(TyperCommand):
    """Accepts texts that start with a dash, such as -1."""

    ignore_unknown_options = True


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation: how it reads its texts, their number, and what it computes.

    With the number 0 it takes two or more texts, and combines the result of the first two with the next.
    """

    read: Callable[[str], Any]
    count: int
    compute: Callable[..., Any]

    def result(self, texts: Sequence[str]) -> dict[str, Any]:
        """The result for some texts, as JSON."""
        items = [self.read(text) for text in texts]
        found = self.compute(*items) if self.count else functools.reduce(self.compute, items)
        if isinstance(found, dict):
            return found
        return describe_caps(found) if isinstance(found, Caps) else {"result": found}


def describe_result(found: Value | None) -> dict[str, Any]:
    """A value as the result of an operation."""
    return {"result": None} if found is None else {"result": write_plain(found), **describe_value(found)}


def _deserialize(kind: str, text: str) -> dict[str, Any]:
    name = TYPES.get(kind)
    if name is None or name not in READERS:
        raise CapsSyntax(
            f"no type {kind!r} of simple values", 0, len(kind), hint=f"types are {', '.join(READERS)}"
        )
    found = READERS[name](text)
    if found is None:
        raise CapsSyntax(f"{text!r} is no value of type {name}", 0, len(text))
    return describe_result(found)


def _relation(one: Caps, other: Caps) -> dict[str, Any]:
    return {
        "equal": one == other,
        "strictly_equal": one.strictly_equal(other),
        "subset": one <= other,
        "superset": other <= one,
        "can_intersect": one.can_intersect(other),
    }


def _fixate(caps: Caps) -> Caps:
    if caps.is_any:
        raise CapsSyntax("ANY cannot be fixated: it allows every format", 0, 3, hint="give caps with a name")
    return caps.fixate()


OPERATIONS: dict[str, Operation] = {
    "parse": Operation(Caps, 1, lambda caps: caps),
    "intersect": Operation(Caps, 0, Caps.intersect),
    "union": Operation(Caps, 0, operator.or_),
    "subset": Operation(Caps, 2, operator.le),
    "equal": Operation(Caps, 2, operator.eq),
    "strictly-equal": Operation(Caps, 2, Caps.strictly_equal),
    "can-intersect": Operation(Caps, 2, Caps.can_intersect),
    "is-fixed": Operation(Caps, 1, lambda caps: caps.is_fixed),
    "relate": Operation(Caps, 2, _relation),
    "fixate": Operation(Caps, 1, _fixate),
    "normalize": Operation(Caps, 1, Caps.normalize),
    "simplify": Operation(Caps, 1, Caps.simplify),
    "truncate": Operation(Caps, 1, Caps.truncate),
    "deserialize": Operation(str, 2, _deserialize),
    "value": Operation(read_value, 1, describe_result),
    "value-intersect": Operation(
        read_value, 2, lambda one, other: describe_result(intersect_values(one, other))
    ),
    "value-union": Operation(read_value, 2, lambda one, other: describe_result(unite_values(one, other))),
    "value-subset": Operation(read_value, 2, is_subset_value),
    "value-equal": Operation(read_value, 2, values_equal),
}
INTERSECT_FIRST = Operation(Caps, 0, operator.and_)
SYNONYMS = {"normalise": "normalize", "merge": "union", "fixed": "is-fixed"}


def find_operation(operation: str, mode: str, count: int) -> Operation:
    """The operation of a name, for so many texts; raises `DescriptionError` with the code `usage`."""
    name = operation.replace("_", "-")
    found = OPERATIONS.get(SYNONYMS.get(name, name))
    if mode not in ("zigzag", "first"):
        raise DescriptionError("usage", f"--mode takes zigzag or first, got {mode!r}")
    if found is None:
        hint = f"operations are {', '.join(OPERATIONS)}"
        raise DescriptionError("usage", f"no operation {operation!r}", hint=hint)
    if mode == "first" and name == "intersect":
        found = INTERSECT_FIRST
    if count != found.count and (found.count or count < 2):
        raise DescriptionError("usage", f"{name} takes {found.count or '2 or more'} texts, got {count}")
    return found


@parsed_by(CapsCommand)
def caps(
    operation: Annotated[str, typer.Argument(metavar="OP", help=f"One of {', '.join(OPERATIONS)}.")],
    texts: Annotated[list[str], typer.Argument(metavar="CAPS...", help="What it works on, as text.")],
    mode: Annotated[
        str,
        typer.Option(help="Order of an intersection: zigzag as gst_caps_intersect, or first as the first's."),
    ] = "zigzag",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON on a terminal, too.")] = False,
) -> None:
    """Computes with caps and prints the result: text on a terminal, else a JSON object.

    Caps are {"caps": text, "any", "empty", "size", "fixed", "structures"}; a
    structure is {"name", "features", "fields": {name: {"type", "value"}}}.

    What is true or false is {"result": true} or {"result": false}.

    The value operations work on single values as they stand in a field and
    print {"result": text, "type", "value"}; deserialize takes a type and a text.

    A bad text ends with exit code 2 and an error on stderr: on a terminal the
    line with a mark, else {"error": {"code", "message", "line", "column",
    "length", "hint"}}.
    """
    try:
        result = find_operation(operation, mode, len(texts)).result(texts)
    except CapsSyntax as error:
        text = next((text for text in texts if repr(text)[:-1] in str(error)), texts[0])
        _fail(
            DescriptionError("syntax", error.rule, place_in(text, error), error.hint), text, as_json=as_json
        )
    except CapsTooLarge as error:
        _fail(DescriptionError("too-large", str(error)), as_json=as_json)
    except DescriptionError as error:
        _fail(error, as_json=as_json)
    is_text = sys.stdout.isatty() and not as_json
    typer.echo(as_text(result) if is_text else json.dumps(result, indent=2))


def _fail(error: DescriptionError, text: str | None = None, *, as_json: bool) -> NoReturn:
    """Exits because of a bad text or usage: with lines for people on a terminal, else a JSON object."""
    if as_json or not sys.stderr.isatty():
        fail_description(error, Description("", "caps", {}), as_json=True)
    typer.echo(f"error: {error}" if text is None else error.pointed(text, "caps"), err=True)
    raise typer.Exit(USAGE_EXIT)


def as_text(found: dict[str, Any]) -> str:
    """A result for people: caps with a structure on each line, a value, yes or no."""
    words = {True: "yes", False: "no", None: "nothing"}
    if "caps" in found:
        return str(found["caps"]).replace("; ", ";\n")
    if "result" in found:
        return words.get(found["result"], str(found["result"]))
    return "\n".join(f"{name.replace('_', ' ')}: {words[answer]}" for name, answer in found.items())


def place_in(text: str, error: CapsSyntax) -> Place:
    """Line and column of an error."""
    before = text[: error.position]
    return Place(before.count("\n") + 1, error.position - before.rfind("\n"), error.length)


def describe_caps(caps: Caps) -> dict[str, Any]:
    """`{"caps", "any", "empty", "size", "fixed", "structures"}`."""
    return {
        "caps": str(caps),
        "any": caps.is_any,
        "empty": caps.is_empty,
        "size": len(caps.structures),
        "fixed": caps.is_fixed,
        "structures": [describe_structure(structure) for structure in caps.structures],
    }


def describe_structure(structure: Structure) -> dict[str, Any]:
    """`{"name", "features", "fields"}`, a field as `{"type", "value"}`."""
    return {
        "name": structure.name,
        "features": list(structure.features),
        "fields": {name: describe_value(value) for name, value in structure.fields.items()},
    }


def describe_value(value: Value) -> dict[str, Any]:
    """`{"type", "value"}`, with GStreamer's type name, of ranges, lists and arrays that of their members."""
    return {"type": type_name(value), "value": plain_value(value)}


def plain_value(value: Value) -> Any:
    """A JSON value: `{"range": [low, high(, step)]}`, `{"list": [...]}`, `{"array": [...]}`, ..."""
    if isinstance(value, ValueList):
        return {"list": [describe_value(item) for item in value.items]}
    if isinstance(value, ValueArray):
        return {"array": [describe_value(item) for item in value.items]}
    if isinstance(value, IntRange):
        ends = [value.low, value.high] + ([value.step] if value.step != 1 else [])
        return {"range": [int(end) for end in ends]}
    if isinstance(value, Range):
        return {"range": [plain_value(value.low), plain_value(value.high)]}
    if isinstance(value, FlagSet):
        return {"flags": value.flags, "mask": value.mask}
    if isinstance(value, Caps):
        return describe_caps(value)
    if isinstance(value, Structure):
        return describe_structure(value)
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, date):
        return value.isoformat()
    return None if isinstance(value, NullText) else value
