"""What `streamkit fleet` does to the feeds on Ray; the actors are the only record of what runs."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import ray
from ray.exceptions import RayError
from ray.util import list_named_actors

from streamkit import ResourceError
from streamkit_fleet.admission import excess
from streamkit_fleet.feed_actor import STOP_LIMIT_S, FeedActor, FeedStatus
from streamkit_fleet.feeds import FeedSpec

PREFIX = "feed:"
ANSWER_LIMIT_S = 1.5
POLL_S = 0.2
TAG_SHARE = 0.001  # of a custom resource: it only says where a feed may run


def running() -> dict[str, Any]:
    """The actors of all feeds, by name."""
    found = {}
    for name in list_named_actors():
        if name.startswith(PREFIX):
            try:
                found[name.removeprefix(PREFIX)] = ray.get_actor(name)
            except ValueError:  # it has ended since
                continue
    return found


def start(name: str, feed: FeedSpec, avoid: str = "") -> None:
    """Gives a feed to Ray, which starts it where there is room.

    Args:
        name: of the feed.
        feed: its entry in the table.
        avoid: a node on which it must not run.
    """
    where = {"label_selector": {"ray.io/node-id": f"!{avoid}"}} if avoid else {}
    memory = {"memory": feed.memory_mb << 20} if feed.memory_mb else {}
    actor: Any = ray.remote(FeedActor)
    actor.options(
        name=f"{PREFIX}{name}",
        lifetime="detached",
        max_restarts=feed.max_restarts,
        num_cpus=feed.cores,
        num_gpus=feed.gpus,
        resources=dict.fromkeys(feed.tags, TAG_SHARE),
        **memory,
        **where,
    ).remote(name, feed)


def statuses(limit_s: float = ANSWER_LIMIT_S) -> list[FeedStatus]:
    """How each feed is, in order of their names; one that does not answer in time is restarting."""
    asked = {name: actor.status.remote() for name, actor in running().items()}
    if not asked:
        return []
    answered, _ = ray.wait(list(asked.values()), num_returns=len(asked), timeout=limit_s)
    done = set(answered)
    return [_status(name, ref, ref in done) for name, ref in sorted(asked.items())]


def _status(name: str, ref: Any, has_answered: bool) -> FeedStatus:
    reason = "does not answer: Ray has no room for it, or starts it again"
    if has_answered:
        try:
            found: FeedStatus = ray.get(ref)
        except RayError as error:
            reason = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        else:
            return found
    return FeedStatus(name=name, state="restarting", reason=reason)


def apply(feeds: Mapping[str, FeedSpec]) -> dict[str, str]:
    """Makes what runs equal to a table; feeds that did not change go on undisturbed.

    Returns:
        What was done by feed: started, stopped, replaced, unchanged.
    """
    known = {status.name: status for status in statuses(limit_s=10.0)}
    done = dict.fromkeys(known.keys() - feeds.keys(), "stopped")
    for name, feed in feeds.items():
        if name not in known:
            done[name] = "started"
        else:
            is_same = known[name].digest == feed.digest and known[name].state != "refused"
            done[name] = "unchanged" if is_same else "replaced"
    stop(name for name, what in done.items() if what in ("stopped", "replaced"))
    for name, what in done.items():
        if what in ("started", "replaced"):
            start(name, feeds[name])
    return done


def wait_ready(limit_s: float) -> list[str]:
    """Waits until all feeds are ready or at their end; says of each other one what it lacks."""
    deadline_s = time.monotonic() + limit_s
    while True:
        late = [status for status in statuses() if not status.ready and status.state != "ended"]
        if not late or time.monotonic() >= deadline_s:
            break
        time.sleep(POLL_S)
    free: dict[str, float] = ray.available_resources() if late else {}  # type: ignore[no-untyped-call]
    room = f"; free of all machines: {free.get('CPU', 0.0):g} cores, {free.get('GPU', 0.0):g} GPUs"
    return [f"{one.name}: {one.reason}{room if one.state == 'restarting' else ''}" for one in late]


def admit(new: Mapping[str, FeedSpec], limit_s: float) -> dict[str, str]:
    """Refuses those of the new feeds whose machines have no room for their measured cost.

    Args:
        new: the feeds that may be refused.
        limit_s: how long to wait for the measurement; a feed without one is admitted.

    Returns:
        Why, by feed.
    """
    deadline_s = time.monotonic() + limit_s
    while True:
        ready = {status.name: status for status in statuses() if status.ready}
        if all(ready[name].cores for name in ready.keys() & new) or time.monotonic() >= deadline_s:
            break
        time.sleep(POLL_S)
    refused: dict[str, str] = {}
    for node in ray.nodes():  # type: ignore[no-untyped-call]
        needs = {name: one.cores for name, one in ready.items() if one.node == node["NodeID"]}
        here = {name: feed for name, feed in new.items() if name in needs}
        refused |= excess(needs, node["Resources"].get("CPU", 0.0), here)
    _wait([actor.refuse.remote(refused[name]) for name, actor in running().items() if name in refused])
    return refused


def stop(names: Iterable[str]) -> None:
    """Ends the streams of feeds, so that files are completed, then their processes."""
    actors = running()
    ending = {name: actors[name] for name in names if name in actors}
    _wait([actor.stop.remote() for actor in ending.values()])
    for actor in ending.values():
        ray.kill(actor, no_restart=True)


def _wait(stops: list[Any]) -> None:
    """Waits until streams have ended."""
    if stops:
        ray.wait(stops, num_returns=len(stops), timeout=STOP_LIMIT_S + 5.0)


def drain(node: str, feeds: Mapping[str, FeedSpec]) -> list[str]:
    """Moves the feeds of a node to others; returns their names.

    Args:
        node: the beginning of its id, as `status` shows it.
        feeds: the table, for the entries of the feeds.

    Raises:
        ResourceError: no node has this id, or a feed is not in the table.
    """
    nodes = [str(one["NodeID"]) for one in ray.nodes() if one["Alive"]]  # type: ignore[no-untyped-call]
    matching = [one for one in nodes if one.startswith(node)]
    if len(matching) != 1:
        raise ResourceError(f"no single node begins with {node!r}; there are {', '.join(map(str, nodes))}")
    moving = [status.name for status in statuses() if status.node == matching[0]]
    if missing := [name for name in moving if name not in feeds]:
        raise ResourceError(f"the table has no feed {missing[0]}, which runs on that node; apply it first")
    stop(moving)
    for name in moving:
        start(name, feeds[name], avoid=matching[0])
    return moving


def logs(name: str) -> list[str]:
    """The newest lines of a feed.

    Raises:
        ResourceError: there is no such feed, or it does not answer.
    """
    actors = running()
    if name not in actors:
        raise ResourceError(f"no feed {name!r} runs; there are {', '.join(sorted(actors)) or 'none'}")
    try:
        lines: list[str] = ray.get(actors[name].logs.remote(), timeout=10.0)
    except RayError as error:
        raise ResourceError(f"feed {name} does not answer: {type(error).__name__}") from error
    return lines
