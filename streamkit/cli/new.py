"""`streamkit new`: creates a plugin package that installs and passes its own test."""

from __future__ import annotations

import importlib.util
import keyword
import re
import sys
from pathlib import Path
from string import Template
from typing import Annotated, Literal

import typer

from streamkit.cli.stderr import fail_usage

TEMPLATES = Path(__file__).with_name("plugin_template")
NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
MAX_NAME = 50


ElementKind = Literal["transform", "source", "sink"]
SUMMARIES: dict[ElementKind, str] = {
    "transform": "Multiplies the brightness of each frame.",
    "source": "Makes a grey ramp that moves sideways.",
    "sink": "Writes the mean brightness of each frame into a text file, one line a frame.",
}
EXAMPLE_PIPELINES: dict[ElementKind, str] = {
    "transform": "videotestsrc num-buffers=30 ! {} gain=1.5 ! fakesink",
    "source": "{} num-buffers=30 ! fakesink",
    "sink": "videotestsrc num-buffers=30 ! {} location=means.txt",
}


def new(
    name: Annotated[str, typer.Argument(help="Name of the package, for example my-blur.")],
    kind: Annotated[ElementKind, typer.Option(help="Kind of its element.")] = "transform",
) -> None:
    """Creates a plugin package in a new folder; it installs, and its own test passes."""
    check_free_name(name)
    folder = Path(name)
    try:
        write_package(folder, kind)
    except FileExistsError:
        fail_usage(f"{folder}: the folder exists already; take another name, or remove it")
    except OSError as error:
        fail_usage(f"{folder}: the package cannot be written: {error.strerror}")
    typer.echo(
        f"{folder}: a package with the element {element_name(name)}. Now:\n"
        f'    cd {folder}\n    pip install -e ".[test]"\n    python -m pytest\n'
        f'    streamkit launch "{EXAMPLE_PIPELINES[kind].format(element_name(name))}"'
    )


def element_name(name: str) -> str:
    """The element's name in descriptions: the package name without dashes."""
    return name.replace("-", "")


def check_free_name(name: str) -> None:
    """Refuses a name that is invalid for a package, module or element, or already in use."""
    if not NAME.fullmatch(name) or len(name) > MAX_NAME:
        suggestion = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-0123456789")[:MAX_NAME]
        hint = f"; {suggestion!r} would do" if NAME.fullmatch(suggestion) else ""
        fail_usage(
            "a package's name has lower-case letters, digits and single dashes, begins with a letter and has "
            f"at most {MAX_NAME} characters, got {name!r}{hint}"
        )
    package = name.replace("-", "_")
    if keyword.iskeyword(package) or package in sys.stdlib_module_names or package in ("streamkit", "tests"):
        fail_usage(f"{package!r} is a name of Python's or streamkit's own; take another, such as 'my-{name}'")
    if importlib.util.find_spec(package) is not None:
        fail_usage(
            f"there is a package {package!r} in this environment, which the new one would hide; "
            f"take another name, such as 'my-{name}'"
        )
    from streamkit.element.registry import available_elements
    from streamkit.graph.bins import BIN_CLASSES

    if element_name(name) in BIN_CLASSES:
        fail_usage(f"{name!r} is a bin in descriptions; take another name, such as 'my-{name}'")
    taken = available_elements().get(element_name(name))
    if taken is not None:
        fail_usage(
            f"there is an element {taken.name!r} already, of {taken.package} {taken.version}; "
            "take another name"
        )


def write_package(folder: Path, kind: ElementKind) -> None:
    """Writes a package, named after its new folder; raises `FileExistsError` or another `OSError`."""
    name = folder.name
    package, element = name.replace("-", "_"), element_name(name)
    words = {
        "distribution": name,
        "package": package,
        "element": element,
        "class_name": "".join(word.capitalize() for word in name.split("-")),
        "summary": SUMMARIES[kind],
        "pipeline": EXAMPLE_PIPELINES[kind].format(element),
    }
    folder.mkdir()
    for template, target in (
        ("pyproject.toml", "pyproject.toml"),
        ("README.md", "README.md"),
        ("package.py", f"src/{package}/__init__.py"),
        (f"{kind}.py", f"src/{package}/element.py"),
        (f"test_{kind}.py", f"tests/test_{package}.py"),
    ):
        text = Template((TEMPLATES / f"{template}.txt").read_text(encoding="utf-8")).substitute(words)
        file = folder / target
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
