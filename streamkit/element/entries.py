"""Entry points of plugins: elements and commands, each imported when it is first used."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from streamkit.errors import PluginBroken

OWN_PACKAGE = "streamkit"


@dataclass(frozen=True, slots=True)
class PluginEntry:
    """An element or command that an installed package offers.

    Attributes:
        kind: "element" or "command".
        name: as users write it.
        target: "module:attribute".
        distribution: the package; its metadata, slow to read, are read on demand; None for the engine.
        rivals: entries of the same name in other packages, which are not used.
    """

    kind: str
    name: str
    target: str
    distribution: importlib.metadata.Distribution | None = None
    rivals: tuple[PluginEntry, ...] = ()

    @property
    def package(self) -> str:
        """Name of the distribution."""
        if self.distribution is not None:
            return self.distribution.name
        return "streamkit" if self.target.startswith("streamkit.cli.") else "unknown package"

    @property
    def version(self) -> str:
        """Version of the distribution."""
        return self.distribution.version if self.distribution else ""

    @property
    def where(self) -> str:
        """Kind, name, target and package in a few words."""
        version = f" {self.version}" if self.distribution is not None or self.kind == "element" else ""
        return f"{self.kind} {self.name!r} ({self.target}, {self.package}{version})"

    def docstring(self) -> str | None:
        """The target's docstring, read from its source: importing all of them would take seconds; or None."""
        module_name, _, name = self.target.partition(":")
        top, *rest = module_name.split(".")
        try:
            spec = find_spec(top)
            if spec is None or spec.origin is None:
                return None
            path = Path(spec.origin).parent.joinpath(*rest) if rest else Path(spec.origin)
            tree = ast.parse(path.with_suffix(".py").read_bytes())
        except Exception:  # loading the package reports the cause
            return None
        kinds = (ast.FunctionDef, ast.ClassDef)
        return next(
            (ast.get_docstring(node) for node in tree.body if isinstance(node, kinds) and node.name == name),
            None,
        )

    def load(self) -> Any:
        """Imports the target.

        Raises:
            PluginBroken: it cannot be imported.
        """
        module_name, _, attribute = self.target.partition(":")
        try:
            return getattr(importlib.import_module(module_name), attribute)
        except (Exception, SystemExit) as cause:
            raise self.broken("loaded", cause) from cause

    def broken(self, done: str, cause: BaseException) -> PluginBroken:
        """The error for an entry that cannot be loaded or made: where, the cause, the remedy."""
        text = f"{type(cause).__name__}: {cause}"
        if isinstance(cause, SyntaxError) and cause.filename:
            line = (cause.text or "").strip()
            text = f"SyntaxError: {cause.msg} ({cause.filename}:{cause.lineno}:{cause.offset}: {line})"
        return PluginBroken(f"{self.where} cannot be {done}: {text}; {self.remedy}")

    @property
    def rivalry(self) -> str:
        """The packages that offer this name, if several do, else ""."""
        if not self.rivals:
            return ""
        others = " and ".join(f"{rival.package} {rival.version}".rstrip() for rival in self.rivals)
        return f"{self.kind} {self.name!r} is in {self.package} {self.version}, and in {others}"

    @property
    def is_own(self) -> bool:
        """Whether streamkit itself offers it."""
        return self.package == OWN_PACKAGE

    @property
    def remedy(self) -> str:
        """What to do if it does not work."""
        return f"reinstall or update {self.package}, or tell its author"


def installed_entries(kind: str, group: str) -> list[PluginEntry]:
    """The entries of a group of all installed packages, sorted by name."""
    found = sorted(importlib.metadata.entry_points(group=group), key=lambda entry: entry.name)
    return [PluginEntry(kind, entry.name, entry.value, entry.dist) for entry in found]


def entries_by_name(entries: Iterable[PluginEntry]) -> dict[str, PluginEntry]:
    """One entry of each name, with the others as its rivals.

    Streamkit's own comes before those of other packages: none can replace it by its name. An entry without a
    package is of the running program, and comes before all.
    """
    named: dict[str, list[PluginEntry]] = {}
    for entry in entries:
        named.setdefault(entry.name, []).append(entry)
    return {name: found[0] if len(found) == 1 else _first(found) for name, found in named.items()}


def _first(entries: list[PluginEntry]) -> PluginEntry:
    if entries[0].distribution is None:
        return entries[0]
    packages: dict[str, PluginEntry] = {}  # one may be on the path twice
    for entry in entries:
        packages.setdefault(entry.package, entry)
    first, *rivals = sorted(packages.values(), key=lambda entry: not entry.is_own)
    return replace(first, rivals=tuple(rivals))
