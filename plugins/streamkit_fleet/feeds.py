"""The table of feeds: fleet.toml."""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec

from streamkit import Pipeline, ResourceError, StreamkitError, missing_variables

SCHEMES = ("env:", "file:")
# Ray's own resources, which a machine cannot have as tags.
RESERVED_TAGS = frozenset({"CPU", "GPU", "memory", "object_store_memory"})
OF_A_PROCESS = ("nice", "tags", "max_restarts")  # feeds that share one must agree in these
Quantity = Annotated[float, msgspec.Meta(ge=0, le=1e6)]  # the limits refuse inf and nan, too


class FeedSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A feed: a pipeline, its variables, and what it needs of a machine.

    Attributes:
        file: the description's file, from the folder of the table; or
        text: the description itself.
        set: values of its variables.
        secrets: values of its variables by reference: "env:NAME" or "file:PATH", read where the feed runs.
        process: that it shares with the other feeds which name it; "" is one of its own.
        cores, gpus: that Ray reserves for it.
        memory_mb: that Ray reserves for it, MB; 0 is none.
        frame_rate: that it must hold, 1/s; a feed for whose measured cost there is no room is refused.
        nice: of its process, 0 to 19; where cores are short, feeds with a higher one drop frames first.
        tags: custom resources of the machines it may run on, as of `ray start --resources`.
        max_restarts: by Ray, of a process that died; -1 is no limit.
        metrics: HOST:PORT of its metrics; port 0 takes a free one; "" is none.
    """

    file: str = ""
    text: str = ""
    set: dict[str, str | int | float] = {}
    secrets: dict[str, str] = {}
    process: str = ""
    cores: Quantity = 1.0
    gpus: Quantity = 0.0
    memory_mb: Annotated[int, msgspec.Meta(ge=0, le=10**9)] = 0
    frame_rate: Quantity = 25.0
    nice: Annotated[int, msgspec.Meta(ge=0, le=19)] = 0
    tags: list[str] = []
    max_restarts: Annotated[int, msgspec.Meta(ge=-1)] = -1
    metrics: str = "127.0.0.1:0"

    def variables(self) -> dict[str, str]:
        """The values of the variables, with the secrets that this machine has.

        Raises:
            ResourceError: a secret is not there; names the reference, never the value.
        """
        secrets = {name: resolve(reference) for name, reference in self.secrets.items()}
        return {name: str(value) for name, value in self.set.items()} | secrets


class FeedProcess(msgspec.Struct, frozen=True, kw_only=True):
    """A process: its feeds, and what all of them say of it.

    Attributes:
        name: "process:NAME" where feeds share it, else "feed:NAME".
        feeds: by their names.
        nice, tags, max_restarts: as those of each feed.
    """

    name: str
    feeds: dict[str, FeedSpec]
    nice: int
    tags: list[str]
    max_restarts: int

    @property
    def digest(self) -> str:
        """Changes if anything of the feeds does."""
        return hashlib.sha256(msgspec.json.encode(self.feeds, order="sorted")).hexdigest()


def by_process(feeds: Mapping[str, FeedSpec]) -> dict[str, FeedProcess]:
    """The processes of feeds, by their names.

    Raises:
        ResourceError: feeds that share a process disagree on it.
    """
    found: dict[str, dict[str, FeedSpec]] = {}
    for name, feed in feeds.items():
        process = f"process:{feed.process}" if feed.process else f"feed:{name}"
        found.setdefault(process, {})[name] = feed
    return {name: _process(name, members) for name, members in found.items()}


def _process(name: str, feeds: dict[str, FeedSpec]) -> FeedProcess:
    first, *others = feeds.values()
    common = {key: getattr(first, key) for key in OF_A_PROCESS}
    for key, value in common.items():
        if any(getattr(feed, key) != value for feed in others):
            raise ResourceError(f"feeds of process {first.process} must have the same {key}")
    return FeedProcess(name=name, feeds=feeds, **common)


def resolve(reference: str) -> str:
    """The value of "env:NAME" or "file:PATH".

    Raises:
        ResourceError: it is not there.
    """
    kind, _, name = reference.partition(":")
    try:
        return os.environ[name] if kind == "env" else Path(name).read_text("utf-8").strip()
    except (KeyError, OSError) as error:
        raise ResourceError(f"the secret {reference} is not there ({type(error).__name__})") from None


def read_feeds(path: Path) -> dict[str, FeedSpec]:
    """The feeds of a table by name, each with the defaults and the text of its description.

    Raises:
        ResourceError: the table or a description cannot be read or is invalid; names file and feed.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ResourceError(f"cannot read the feeds of {path}: {error}") from error
    if unknown := sorted(table.keys() - {"defaults", "feeds"}):
        raise ResourceError(f"{path}: has [defaults] and [feeds.NAME] only, got {unknown[0]!r}")
    defaults, feeds = table.get("defaults", {}), table.get("feeds")
    if not feeds or not isinstance(feeds, dict):
        raise ResourceError(f"{path}: has no feed; write [feeds.NAME]")
    for place, part in [("defaults", defaults), *((f"feeds.{name}", row) for name, row in feeds.items())]:
        _check_tables(path, place, part)
    found = {name: _feed(path, name, defaults, row) for name, row in feeds.items()}
    try:
        by_process(found)
    except ResourceError as error:
        raise ResourceError(f"{path}: {error}") from None
    return found


def _check_tables(path: Path, place: str, part: Any) -> None:
    """Checks that a part of the table, and what it has of `set` and `secrets`, are tables."""
    parts = {place: part}
    if isinstance(part, dict):
        parts |= {f"{place}.{key}": part[key] for key in ("set", "secrets") if key in part}
    for name, value in parts.items():
        if not isinstance(value, dict):
            raise ResourceError(f"{path}: {name} must be a table; write [{name}] and a line for each key")


def _feed(path: Path, name: str, defaults: dict[str, Any], row: dict[str, Any]) -> FeedSpec:
    merged = {**defaults, **row}
    for key in ("set", "secrets"):
        merged[key] = {**defaults.get(key, {}), **row.get(key, {})}
    if "text" in row:
        merged.pop("file", None)
    try:
        feed = msgspec.convert(merged, FeedSpec)
        if not feed.text and not feed.file:
            raise ResourceError("it has no description; write file= or text=")
        text = feed.text or (path.parent / feed.file).read_text("utf-8")
        feed = msgspec.structs.replace(feed, file="", text=text)
        given = msgspec.structs.replace(feed, secrets={}).variables() | dict.fromkeys(feed.secrets, "x")
        if missing := missing_variables(text, given):
            remedy = f'write set = {{ {missing[0]} = "VALUE" }}'
            raise ResourceError(f"variable {missing[0]!r} has no value and no default; {remedy}")
        Pipeline.parse(text, given)
    except (msgspec.ValidationError, UnicodeDecodeError, StreamkitError) as error:
        raise ResourceError(f"{path}: feed {name}: {error}") from error
    except OSError as error:
        raise ResourceError(f"{path}: feed {name}: cannot read {error.filename}: {error.strerror}") from error
    for reference in feed.secrets.values():
        if not reference.startswith(SCHEMES):
            raise ResourceError(f"{path}: feed {name}: a secret is a reference, env:NAME or file:PATH")
    if taken := RESERVED_TAGS.intersection(feed.tags):
        rule = "write cores, gpus and memory_mb for what every machine has"
        raise ResourceError(f"{path}: feed {name}: {min(taken)} is no tag of a machine; {rule}")
    return feed
