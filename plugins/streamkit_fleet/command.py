"""`streamkit fleet`: runs many feeds on Ray, on one machine or a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from streamkit import StateError, StreamkitError, exit_with_error
from streamkit.masking import presentable

if TYPE_CHECKING:
    from streamkit_fleet.feed import FeedStatus

fleet = typer.Typer(
    help="Runs many feeds on Ray, on one machine or a cluster.", no_args_is_help=True, add_completion=False
)

TableArgument = Annotated[Path, typer.Argument(help="The table of feeds.", exists=True, dir_okay=False)]
AddressOption = Annotated[
    str | None,
    typer.Option(envvar="RAY_ADDRESS", help="HOST:PORT of a Ray cluster; else this machine's."),
]

WaitOption = Annotated[float, typer.Option(min=0.0, help="How long to wait until all feeds are ready, s.")]


STATUS_COLUMNS = ("feed", "state", "node", "cores", "frames", "dropped", "restarts", "metrics", "missing")


def _columns(status: FeedStatus) -> tuple[str, ...]:
    """The texts under `STATUS_COLUMNS`."""
    counts = f"{status.cores:.2f}", f"{status.frames}", f"{status.dropped}", f"{status.restarts}"
    return (status.name, status.state, status.node[:8], *counts, status.metrics, status.reason)


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row; its texts begin at the same columns as those of the others."""
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


@contextmanager
def _exit_on_error() -> Iterator[None]:
    try:
        yield
    except StreamkitError as error:
        exit_with_error(str(error))


@contextmanager
def _connected(address: str | None, *, ends_it: bool = False) -> Iterator[Any]:
    """Context with a connection to the fleet, and what can be done with it: the module `control`."""
    with _exit_on_error():
        from streamkit_fleet import local_ray

        local = None if address else local_ray.known()
        if not address and local is None:
            raise StateError("no fleet runs on this machine; start one with `streamkit fleet up`")
        if local is not None:
            if local.is_ending and not ends_it:
                raise StateError(
                    "`streamkit fleet down` is ending the fleet of this machine; wait for its end"
                )
            if ends_it:
                local_ray.begin_end(local)
            local_ray.use_token()
        at = local.address if local else address
        with local_ray.connected(at, wait_s=local_ray.START_LIMIT_S if local else 0.0):
            from streamkit_fleet import control

            yield control


@fleet.command()
def up(
    table: TableArgument,
    address: AddressOption = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Of this machine; by default all.")] = None,
    wait_s: WaitOption = 30.0,
) -> None:
    """Starts the feeds of a table; without --address on a Ray of this machine, started if there is none."""
    with _exit_on_error():
        from streamkit_fleet import local_ray
        from streamkit_fleet.feeds import read_feeds

        read_feeds(table)  # no Ray is started, and left running, for a table with a mistake
        if not address and local_ray.known() is None:
            local_ray.start(cores)
    apply(table, address, wait_s)


@fleet.command()
def apply(table: TableArgument, address: AddressOption = None, wait_s: WaitOption = 30.0) -> None:
    """Starts, stops and replaces feeds until what runs is what the table says; others go on undisturbed.

    Exit code 1 if a feed is refused: its machine has no room for what it was measured to need.
    """
    with _connected(address) as control:
        from streamkit_fleet.feeds import read_feeds

        feeds = read_feeds(table)
        done = control.apply(feeds)
        for name, what in sorted(done.items()):
            typer.echo(f"{what:9} {name}")
        for line in control.wait_ready(wait_s):
            typer.echo(f"note: {presentable(line)}", err=True)
        new = {name: feed for name, feed in feeds.items() if done[name] != "unchanged"}
        refused = control.admit(new, wait_s)
        for name, reason in refused.items():
            typer.echo(f"refused   {name}: {reason}", err=True)
    raise typer.Exit(int(bool(refused)))


@fleet.command()
def status(
    address: AddressOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object for each feed.")] = False,
) -> None:
    """Lists the feeds: state, machine, frames, drops, restarts. Exit code 1 if one is not ready."""
    import msgspec

    with _connected(address) as control:
        found = control.statuses()
        if as_json:
            lines = [msgspec.json.encode(row).decode() for row in found]
        else:
            lines = _aligned([STATUS_COLUMNS, *map(_columns, found)])
        for line in lines:  # before Ray's shutdown, which takes .3 s
            typer.echo(line)
    raise typer.Exit(int(not all(row.ready or row.state == "ended" for row in found)))


@fleet.command()
def logs(name: Annotated[str, typer.Argument(help="Of the feed.")], address: AddressOption = None) -> None:
    """Prints the newest lines of a feed's process."""
    with _connected(address) as control:
        lines = control.logs(name)
    for line in lines:
        typer.echo(line)
    if not lines:
        typer.echo(f"note: {name} has printed nothing", err=True)


@fleet.command()
def drain(
    node: Annotated[str, typer.Argument(help="The beginning of its id, as status shows it.")],
    table: TableArgument,
    address: AddressOption = None,
) -> None:
    """Moves the feeds of a machine to others, before it is switched off."""
    with _connected(address) as control:
        from streamkit_fleet.feeds import read_feeds

        for name in control.drain(node, read_feeds(table)):
            typer.echo(f"moved     {name}")


@fleet.command()
def down(address: AddressOption = None) -> None:
    """Ends every feed, and the Ray that `up` has started."""
    with _connected(address, ends_it=True) as control:
        control.stop(control.running())
    from streamkit_fleet import local_ray

    local = None if address else local_ray.known()
    if local is not None:
        local_ray.end(local)
