"""What `streamkit fleet` does to the feeds on Ray; the actors are the only record of what runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
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
    """Gives a feed to Ray, which starts it where there is room, but not on the node to avoid."""
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
    answered = set(
        ray.wait(list(asked.values()), num_returns=len(asked), timeout=limit_s)[0] if asked else ()
    )
    return [_status(name, ref, ref in answered) for name, ref in sorted(asked.items())]


def _status(name: str, ref: Any, has_answered: bool) -> FeedStatus:
    reason = "does not answer: Ray has no room for it, or starts it again"
    try:
        if has_answered:
            found: FeedStatus = ray.get(ref)
            return found
    except RayError as error:
        reason = f"{type(error).__name__}: {str(error).splitlines()[0]}"
    return FeedStatus(name=name, state="restarting", reason=reason)


def _statuses_until(is_done: Callable[[list[FeedStatus]], bool], limit_s: float) -> list[FeedStatus]:
    """Asks until the statuses are as wanted, or the time is over."""
    deadline_s = time.monotonic() + limit_s
    while not is_done(found := statuses()) and time.monotonic() < deadline_s:
        time.sleep(POLL_S)
    return found


def apply(feeds: Mapping[str, FeedSpec]) -> dict[str, str]:
    """Makes what runs equal to a table; feeds that did not change go on undisturbed.

    Returns:
        What was done by feed: started, stopped, replaced, unchanged.
    """
    known = {status.name: status for status in statuses(limit_s=10.0)}
    done = dict.fromkeys(known.keys() - feeds.keys(), "stopped")
    for name, feed in feeds.items():
        one = known.get(name)
        is_same = one is not None and one.digest == feed.digest and one.state != "refused"
        done[name] = "started" if one is None else "unchanged" if is_same else "replaced"
    stop(name for name, what in done.items() if what in ("stopped", "replaced"))
    for name, what in done.items():
        if what in ("started", "replaced"):
            start(name, feeds[name])
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
    """Moves the feeds of the node whose id begins so, as `status` shows it, to others; returns their names.

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
