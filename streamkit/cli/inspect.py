"""`streamkit inspect`: lists elements, or describes one."""

from __future__ import annotations

import inspect as python_inspect
import json
import re
import shlex
import shutil
import sys
import textwrap
from collections.abc import Container
from typing import TYPE_CHECKING, Annotated, Any

import typer

from streamkit.cli.completion import complete_element
from streamkit.output.colour import coloured

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import PadTemplate
    from streamkit.element.property import PropertyDeclaration

PARAGRAPH_BREAK = re.compile(r"(?<=\S)\n(?=\S)")  # within a paragraph of a docstring
MEANT_BY_SHELLS = frozenset('"$`\\')  # within double quotes
ATTRIBUTES = re.compile(r"^Attributes:\n(?:[ ]+.*\n?|\n(?=[ ]))*", re.MULTILINE)


def inspect(
    element: Annotated[
        str | None,
        typer.Argument(
            help="Name of an element; without it all are listed.", autocompletion=complete_element
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Describe the properties of its base class, too.")
    ] = False,
) -> None:
    """Lists the elements, or one element's pads, caps, properties and example."""
    if element is None:
        _list_all(as_json=as_json)
        return
    facts = describe_element(element)
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
    else:
        from streamkit.element.registry import element_class

        text = as_text(facts, set() if everything else inherited(element_class(element)))
        if sys.stdout.isatty():
            text = coloured("\n".join(map(fitted, PARAGRAPH_BREAK.sub(" ", text).split("\n"))))
        typer.echo(text)


def _list_all(*, as_json: bool) -> None:
    from streamkit.element.registry import available_elements

    entries = available_elements().values()
    if as_json:
        rows = [
            {"name": entry.name, "package": entry.package, "version": entry.version, "class": entry.target}
            for entry in entries
        ]
        typer.echo(json.dumps(rows, indent=2))
        return
    width = max((len(entry.name) for entry in entries), default=0)
    for entry in entries:
        summary = (entry.docstring() or entry.target).partition("\n")[0]
        package = "" if entry.package == "streamkit" else f"  ({entry.package} {entry.version})"
        line = f"{entry.name:<{width}}  {summary}{package}"
        typer.echo(fitted(line, width + 2) if sys.stdout.isatty() else line)


def fitted(line: str, indent: int | None = None) -> str:
    """A line wrapped to the terminal's width; further lines are indented like it, or by `indent`."""
    by = len(line) - len(line.lstrip()) if indent is None else indent
    width = shutil.get_terminal_size().columns
    return textwrap.fill(
        line, width, subsequent_indent=" " * by, break_on_hyphens=False, break_long_words=False
    )


def describe_element(name: str) -> dict[str, Any]:
    """Package, doc, pads, properties and example of an element.

    Raises:
        DescriptionError: the element does not exist.
        PluginBroken: it cannot be loaded.
    """
    from streamkit.element.registry import available_elements, element_class

    found = element_class(name)
    entry = available_elements()[name]
    doc = ATTRIBUTES.sub("", python_inspect.cleandoc(found.__doc__ or ""))  # not for users
    prose, _, example = doc.partition("Example:")
    return {
        "name": name,
        "package": entry.package,
        "version": entry.version,
        "class": entry.target,
        "doc": prose.strip(),
        "example": re.split(r"\n\s*\n", python_inspect.cleandoc(example))[0].strip(),
        "kind": next(kind.__name__ for kind in element_kinds() if issubclass(found, kind)),
        "pads": [_pad_facts(template) for template in found.pad_templates.values()],
        "properties": [_property_facts(declared) for declared in found.properties.values()],
    }


def _pad_facts(template: PadTemplate) -> dict[str, str]:
    return {
        "name": template.name,
        "direction": str(template.direction),
        "presence": str(template.presence),
        "caps": str(template.caps),
    }


def _property_facts(declared: PropertyDeclaration) -> dict[str, Any]:
    return {
        "name": declared.spelling,
        "type": declared.kind.__name__,
        "values": declared.describe(),
        "default": declared.to_json(declared.default),
        "minimum": declared.to_json(declared.minimum),
        "maximum": declared.to_json(declared.maximum),
        "unit": declared.unit,
        "choices": list(declared.choices),
        "live": declared.live,
        "readonly": declared.readonly,
        "doc": declared.doc,
    }


def inherited(found: type[Element]) -> set[str]:
    """The names of the properties that every element of the kind has."""
    kinds = element_kinds()
    return {declared.spelling for declared in found.properties.values() if declared.owner in kinds}


def element_kinds() -> tuple[type[Element], ...]:
    """The base classes that say how many pads an element has, the most general last."""
    from streamkit.element.base import Element
    from streamkit.element.branching import Combine, Split
    from streamkit.element.sink import Sink
    from streamkit.element.source import Source
    from streamkit.element.transform import Transform

    return Source, Sink, Transform, Combine, Split, Element


def as_text(facts: dict[str, Any], folded: Container[str] = ()) -> str:
    """The description of an element as text; of the `folded` properties only the names, at the end."""
    lines = [" - ".join(filter(None, (facts["name"], facts["doc"]))), ""]
    lines.append(f"  {facts['kind']} of {facts['package']} {facts['version']} ({facts['class']})")
    lines += ["", "Pads"]
    for pad in facts["pads"]:
        lines.append(f"  {pad['name']}  {pad['direction']}, {pad['presence']}")
        lines += [f"      {structure.strip()}" for structure in pad["caps"].split(";")]
    if facts["properties"]:
        lines += ["", "Properties"]
        for item in facts["properties"]:
            if item["name"] in folded:
                continue
            live = ", can only be read" if item["readonly"] else ""
            live = live or (", may change while playing" if item["live"] else "")
            default = "none" if item["default"] is None else json.dumps(item["default"])
            lines.append(f"  {item['name']}  ({item['values']}; default {default}{live})")
            lines.append(f"      {item['doc']}")
    names = ", ".join(item["name"] for item in facts["properties"] if item["name"] in folded)
    if names:
        text = f"of every {facts['kind'].lower()} (see --all): {names}"
        lines += textwrap.wrap(text, 96, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
    if facts["example"]:
        lines += ["", "Example", f"  {example_command(facts)}"]
    return "\n".join(lines)


def example_command(facts: dict[str, Any]) -> str:
    """The example as a shell command, in single quotes if the description has double quotes."""
    description = " ".join(facts["example"].split())
    quoted = f'"{description}"' if MEANT_BY_SHELLS.isdisjoint(description) else shlex.quote(description)
    return f"streamkit launch {quoted}"
