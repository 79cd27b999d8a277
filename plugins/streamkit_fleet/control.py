"""What `streamkit fleet` does to the feeds on Ray; the actors are the only record of what runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import ray
from msgspec.structs import replace
from ray.exceptions import RayError
from ray.util import list_named_actors

from streamkit import ResourceError
from streamkit_fleet.feed import STOP_LIMIT_S, Feed, FeedStatus, excess
from streamkit_fleet.feeds import FeedProcess, FeedSpec, by_process

PREFIXES = ("feed:", "process:")
ANSWER_LIMIT_S, APPLY_LIMIT_S = 1.5, 10.0
POLL_S = 0.2
TAG_SHARE = 0.001  # of a custom resource: it only says where a feed may run


class FeedActor:
    """The feeds of a process: mostly one, or those that share it."""

    def __init__(self, process: FeedProcess) -> None:
        context = ray.get_runtime_context()
        restarts = int(context.was_current_actor_reconstructed)
        self._place = {"process": process.name, "node": context.get_node_id(), "pid": os.getpid()}
        os.nice(process.nice)  # of this thread and of those that it starts, not of Ray's
        self._feeds = {
            name: Feed(name, feed, restarts=restarts, sharing=len(process.feeds))
            for name, feed in process.feeds.items()
        }

    def statuses(self) -> list[FeedStatus]:
        """State and counters of each feed."""
        return [replace(feed.status(), **self._place) for feed in self._feeds.values()]

    def logs(self, name: str) -> list[str]:
        """The newest lines of a feed."""
        return self._feeds[name].logs()

    def stop(self) -> None:
        """Ends the streams, so that files are completed, and waits for it."""
        deadline_s = time.monotonic() + STOP_LIMIT_S
        for feed in self._feeds.values():
            feed.stop()
        for feed in self._feeds.values():
            feed.join(max(0.0, deadline_s - time.monotonic()))

    def refuse(self, reasons: Mapping[str, str]) -> None:
        """Ends the streams of feeds for want of room, with the reason of each."""
        for name in reasons.keys() & self._feeds.keys():
            self._feeds[name].refuse(reasons[name])


class RunningProcess(NamedTuple):
    """The actor of a process, and the digest of its feeds.

    Both are in the actor's name, "process:NAME@DIGEST": a process that does not answer is known, too.
    """

    actor: Any
    digest: str


def running() -> dict[str, RunningProcess]:
    """All processes, by their names."""
    found = {}
    for name in list_named_actors():
        if name.startswith(PREFIXES):
            process, _, digest = name.rpartition("@")
            try:
                found[process] = RunningProcess(ray.get_actor(name), digest)
            except ValueError:  # it has ended since
                continue
    return found


def start(process: FeedProcess, avoid: str = "") -> None:
    """Gives a process to Ray, which starts it where there is room, not on the node to avoid."""
    feeds = process.feeds.values()
    where = {"label_selector": {"ray.io/node-id": f"!{avoid}"}} if avoid else {}
    memory_mb = sum(feed.memory_mb for feed in feeds)
    memory = {"memory": memory_mb << 20} if memory_mb else {}
    actor: Any = ray.remote(FeedActor)
    actor.options(
        name=f"{process.name}@{process.digest}",
        lifetime="detached",
        max_restarts=process.max_restarts,
        num_cpus=sum(feed.cores for feed in feeds),
        num_gpus=sum(feed.gpus for feed in feeds),
        resources=dict.fromkeys(process.tags, TAG_SHARE),
        **memory,
        **where,
    ).remote(process)


def statuses(limit_s: float = ANSWER_LIMIT_S) -> list[FeedStatus]:
    """How each feed is, in order of their names; a process that does not answer in time is restarting."""
    asked = {process: one.actor.statuses.remote() for process, one in running().items()}
    answered = set(
        ray.wait(list(asked.values()), num_returns=len(asked), timeout=limit_s)[0] if asked else ()
    )
    rows = (row for process, ref in asked.items() for row in _statuses(process, ref, ref in answered))
    return sorted(rows, key=lambda row: row.name)


def _statuses(process: str, ref: Any, has_answered: bool) -> list[FeedStatus]:
    """Those of a process; one row in its name if it does not answer."""
    reason = "does not answer: Ray has no room for it, or starts it again"
    try:
        if has_answered:
            found: list[FeedStatus] = ray.get(ref)
            return found
    except RayError as error:
        reason = f"{type(error).__name__}: {str(error).splitlines()[0]}"
    name = process.removeprefix("feed:")
    return [FeedStatus(name=name, state="restarting", reason=reason, process=process)]


def _statuses_until(is_done: Callable[[list[FeedStatus]], bool], limit_s: float) -> list[FeedStatus]:
    """Asks until the statuses are as wanted, or the time is over."""
    deadline_s = time.monotonic() + limit_s
    while True:
        asked_s = time.monotonic()
        if is_done(found := statuses()) or time.monotonic() > deadline_s:
            return found
        time.sleep(max(POLL_S, time.monotonic() - asked_s))  # feeds that start need the cores, too


def apply(feeds: Mapping[str, FeedSpec]) -> dict[str, str]:
    """Makes what runs equal to a table; processes whose feeds did not change go on, even one that is silent.

    Returns:
        What was done by feed: started, stopped, replaced, unchanged.
    """
    wanted, there, rows = by_process(feeds), running(), statuses(APPLY_LIMIT_S)
    same = {name for name in wanted.keys() & there.keys() if there[name].digest == wanted[name].digest}
    same -= {row.process for row in rows if row.state == "refused"}
    silent = {row.process for row in rows if not row.pid}
    known = {row.name for row in rows if row.process not in silent & wanted.keys()}
    done = dict.fromkeys(known - feeds.keys(), "stopped")
    for process, found in wanted.items():
        before = "replaced" if process in silent else "started"
        for name in found.feeds:
            done[name] = "unchanged" if process in same else "replaced" if name in known else before
    stop(there.keys() - same)
    for process in wanted.keys() - same:
        start(wanted[process])
    return done


def wait_ready(limit_s: float) -> list[str]:
    """Waits until all feeds are ready or at their end; says of each other one what it lacks."""

    def not_ready(found: list[FeedStatus]) -> list[FeedStatus]:
        return [status for status in found if not status.ready and status.state != "ended"]

    late = not_ready(_statuses_until(lambda found: not not_ready(found), limit_s))
    free: dict[str, float] = ray.available_resources() if late else {}  # type: ignore[no-untyped-call]
    room = f"; free of all machines: {free.get('CPU', 0.0):g} cores, {free.get('GPU', 0.0):g} GPUs"
    return [f"{one.name}: {one.reason}{room if one.state == 'restarting' else ''}" for one in late]


def admit(new: Mapping[str, FeedSpec], limit_s: float) -> dict[str, str]:
    """Refuses those of the new feeds whose machines have no room for their measured cost; says why, by feed.

    A feed without a measurement within the limit is admitted.
    """

    def are_measured(found: list[FeedStatus]) -> bool:
        return all(status.cores for status in found if status.ready and status.name in new)

    ready = {status.name: status for status in _statuses_until(are_measured, limit_s) if status.ready}
    refused: dict[str, str] = {}
    for node in ray.nodes():  # type: ignore[no-untyped-call]
        needs = {name: one.cores for name, one in ready.items() if one.node == node["NodeID"]}
        here = {name: feed for name, feed in new.items() if name in needs}
        refused |= excess(needs, node["Resources"].get("CPU", 0.0), here)
    at = {ready[name].process for name in refused}
    _wait([one.actor.refuse.remote(refused) for process, one in running().items() if process in at])
    return refused


def stop(processes: Iterable[str]) -> None:
    """Ends the streams of processes, so that files are completed, then the processes."""
    there = running()
    ending = [there[process].actor for process in processes if process in there]
    _wait([actor.stop.remote() for actor in ending])
    for actor in ending:
        ray.kill(actor, no_restart=True)


def _wait(stops: list[Any]) -> None:
    """Waits until streams have ended."""
    if stops:
        ray.wait(stops, num_returns=len(stops), timeout=STOP_LIMIT_S + 5.0)


def drain(node: str, feeds: Mapping[str, FeedSpec]) -> list[str]:
    """Moves the feeds of the node whose id begins so, as `status` shows it, to others; returns their names.

    Raises:
        ResourceError: no node has this id, or a feed is not in the table.
    """
    nodes = [str(one["NodeID"]) for one in ray.nodes() if one["Alive"]]  # type: ignore[no-untyped-call]
    matching = [one for one in nodes if one.startswith(node)]
    if len(matching) != 1:
        raise ResourceError(f"no single node begins with {node!r}; there are {', '.join(map(str, nodes))}")
    moving = [status for status in statuses() if status.node == matching[0]]
    wanted = by_process(feeds)
    known = {(process, name) for process, found in wanted.items() for name in found.feeds}
    if missing := [one.name for one in moving if (one.process, one.name) not in known]:
        raise ResourceError(f"the table has no feed {missing[0]}, which runs on that node; apply it first")
    processes = {status.process for status in moving}
    stop(processes)
    for process in processes:
        start(wanted[process], avoid=matching[0])
    return [status.name for status in moving]


def logs(name: str) -> list[str]:
    """The newest lines of a feed.

    Raises:
        ResourceError: there is no such feed, or it does not answer.
    """
    rows = {row.name: row for row in statuses()}
    if name not in rows:
        raise ResourceError(f"no feed {name!r} runs; there are {', '.join(rows) or 'none'}")
    try:
        actor = running()[rows[name].process].actor
        lines: list[str] = ray.get(actor.logs.remote(name), timeout=10.0)
    except (RayError, KeyError) as error:
        raise ResourceError(f"feed {name} does not answer: {type(error).__name__}") from error
    return lines
