"""`streamkit view`: shows video, tracks and mosaic in a browser."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import sys
import webbrowser
from contextlib import ExitStack, closing
from os.path import isdir, isfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from streamkit import ResourceError, choose_source, exit_with_error, needs_extra

if TYPE_CHECKING:
    from streamkit_view.server import ViewServer
    from streamkit_zenoh.configuration import SessionSettings

BACKLOG = 64
USAGE_EXIT = 2
FILE_SUFFIXES = {".jsonl", ".mp4", ".mov", ".mkv", ".ts", ".avi", ".m4v", ".mpg"}


def view(
    what: Annotated[
        list[str],
        typer.Argument(
            help="Keys of zenohsink, for example uav/1; or one video file, URL of live video, or the records "
            "of a finished run, tracks.jsonl."
        ),
    ],
    listen: Annotated[
        str, typer.Option(help="Address of the page; beyond this machine it needs a token.")
    ] = "127.0.0.1:8090",
    connect: Annotated[str | None, typer.Option(help="zenoh endpoint to connect to, tcp/HOST:PORT.")] = None,
    video: Annotated[str, typer.Option(help="Video file of a finished run, whose records are given.")] = "",
    basemap: Annotated[
        Path | None, typer.Option(help="Base map of the geographic map: a GeoTIFF, or a PMTiles archive.")
    ] = None,
    config: Annotated[
        str | None, typer.Option(help="zenoh configuration file, for TLS and passwords.")
    ] = None,
    encode: Annotated[
        bool,
        typer.Option(
            "--encode", help="Encode the video of a live feed that is not H.264 or H.265 anew, here."
        ),
    ] = False,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Shows video, tracks and mosaic of one or more publishers in a browser, until Ctrl-C.

    A video file, a camera's URL or a finished run is played by the ready pipeline, in a process of its own,
    from the moment when the page is opened. Exit code 2 for a wrong argument, 1 if the page cannot be served.
    """
    with needs_extra("the page", "view"):
        from streamkit_view.server import run_server
    from streamkit_view.access import LOG, Access
    from streamkit_view.basemap import InvalidBasemap, read_basemap
    from streamkit_view.locations import is_source
    from streamkit_view.playback import PlayedPipeline
    from streamkit_zenoh.configuration import SessionSettings, is_loopback

    sources = [text for text in what if is_source(text)]
    _check_arguments(what, sources, video, SessionSettings(connect=connect, config=config))
    _check_playable(sources, video)
    if encode and not (sources and choose_source(sources[0]).is_live):
        _refuse(
            "--encode is for the URL of live video; a file is shown in images where browsers do not decode it"
        )
    try:
        base = None if basemap is None else read_basemap(basemap)
    except (InvalidBasemap, ResourceError) as error:
        _refuse(f"--basemap {error}")
    host, bound = _bind(listen)
    token = secrets.token_urlsafe(24)
    # Until the server handles signals itself: what was started is ended by this process only.
    signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(0))
    with ExitStack() as stack:
        stack.enter_context(bound)
        playback = None
        if sources:
            key = f"view/{os.getpid()}"
            playback, what = (
                stack.enter_context(closing(PlayedPipeline(sources[0], key, video, encodes=encode))),
                [key],
            )
        url = _url(host, bound.getsockname()[1], token)
        typer.echo(f"open {url}")
        if open_page:
            webbrowser.open(url)
        try:
            access = Access(token, is_local=is_loopback(host))
            LOG.addHandler(logging.StreamHandler(sys.stderr))
            run_server(what, bound, access, connect, config, playback, base, on_created=_stop_on_signals)
        except (OSError, ValueError) as error:
            exit_with_error(str(error))


def _check_arguments(what: list[str], sources: list[str], video: str, settings: SessionSettings) -> None:
    """Exits with code 2 where an argument is no file, URL, key or endpoint, before the page is announced."""
    from streamkit.output.names import lacks_protocol
    from streamkit_view.locations import wrong_address
    from streamkit_zenoh.configuration import base_configuration
    from streamkit_zenoh.keys import publication_root

    if sources and len(what) > 1:
        _refuse(f"give keys, or one file or URL, got {sources[0]} and {len(what) - 1} more")
    for text in sources:
        if reason := wrong_address(text):
            _refuse(reason)
    for text in {*what, video} - {*sources, ""}:
        if lacks_protocol(text):
            _refuse(f"{text} is the address of a server, without its protocol; begin it with rtsp://")
        if isdir(text):
            _refuse(f"{text} is a folder; give a file, or the key of a zenohsink as {text}/tracks")
        if Path(text).suffix.lower() in FILE_SUFFIXES and not isfile(text):
            _refuse(f"{text}: there is no such file, or its folder is closed to you")
    try:
        base_configuration(settings)
        keys = [] if sources else [publication_root(text) for text in what]
    except (OSError, ValueError) as error:
        _refuse(str(error))
    if twice := [key for key in keys if keys.count(key) > 1]:
        _refuse(f"{twice[0]} is given twice; give each publisher once")


def _check_playable(sources: list[str], video: str) -> None:
    """Exits with code 2 where a file cannot be played, or where records and video are not of one run."""
    from streamkit_view.locations import is_run, size_conflict, unplayable

    if any(map(is_run, sources)) != bool(video):
        _refuse("records and their video go together: streamkit view tracks.jsonl --video flight.mp4")
    for text in filter(None, [*sources, video]):
        if reason := unplayable(text, with_records=text == video):
            _refuse(reason)
    if video and (reason := size_conflict(sources[0], video)):
        _refuse(reason)


def _stop_on_signals(server: ViewServer) -> None:
    """A signal may come before the server handles signals itself; it raises them again at its end."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: server.stop())


def _bind(listen: str) -> tuple[str, socket.socket]:
    """The host, and a socket that listens."""
    host, _, port = listen.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal() or int(port) > 65535:
        _refuse(f"--listen must be HOST:PORT, got {listen}; write for example 127.0.0.1:8090")
    try:
        family, *_, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)[0]
        return host, socket.create_server(address, family=family, backlog=BACKLOG)
    except OSError as error:
        is_unknown = isinstance(error, socket.gaierror)  # its numbers are not those of the system
        reason = error.strerror if is_unknown else os.strerror(error.errno or 0)
        exit_with_error(f"--listen {listen}: {reason}; name another address")


def _url(host: str, port: int, token: str) -> str:
    shown = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/?token={token}"


def _refuse(message: str) -> NoReturn:
    """Exits because of a wrong argument."""
    exit_with_error(message, USAGE_EXIT)
