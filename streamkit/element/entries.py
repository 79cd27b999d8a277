"""Entry points of plugins: elements and commands, each imported when it is first used."""

from __future__ import annotations

import importlib
import importlib.metadata
from dataclasses import dataclass
from typing import Any

from streamkit.errors import PluginBroken


@dataclass(frozen=True, slots=True)
class PluginEntry:
    """An element or command that an installed package offers.

    Attributes:
        kind: "element" or "command".
        name: as users write it.
        target: "module:attribute".
        distribution: the package; its metadata, slow to read, are read on demand; None for the engine.
    """

    kind: str
    name: str
    target: str
    distribution: importlib.metadata.Distribution | None = None

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
        return PluginBroken(
            f"{self.where} cannot be {done}: {type(cause).__name__}: {cause}; "
            f"reinstall or update {self.package}, or tell its author"
        )
