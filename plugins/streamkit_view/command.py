"""`streamkit view`: shows video, tracks and mosaic in a browser."""

from __future__ import annotations

import os
import secrets
import socket
import webbrowser
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from streamkit_view.playback import Playback

BACKLOG = 64
VIDEO_SUFFIXES = {".mp4", ".mov", ".mkv", ".ts", ".avi", ".m4v", ".mpg"}
CLOSE_LIMIT_S = 2.0


def view(
    what: Annotated[
        list[str],
        typer.Argument(help="Keys of zenohsink, for example uav/1; or one video file or rtsp:// URL."),
    ],
    listen: Annotated[
        str, typer.Option(help="Address of the page; beyond this machine it needs a token.")
    ] = "127.0.0.1:8090",
    connect: Annotated[str | None, typer.Option(help="zenoh endpoint to connect to, tcp/HOST:PORT.")] = None,
    config: Annotated[
        str | None, typer.Option(help="zenoh configuration file, for TLS and passwords.")
    ] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Shows video, tracks and mosaic of one or more publishers in a browser, until Ctrl-C.

    A video file or a camera's URL is played by the ready pipeline, in a process of its own, from the moment
    when the page is opened.
    """
    try:
        from streamkit_view.session import run_server
    except ImportError as error:
        _fail(f"the page needs {error.name}, which is not installed: pip install 'streamkit[view]'")
    from streamkit_view.access import is_loopback
    from streamkit_view.playback import is_source, playing

    sources = [text for text in what if is_source(text)]
    if sources and len(what) > 1:
        _fail(f"give keys, or one file or URL, got {sources[0]} and {len(what) - 1} more")
    for text in what:
        if not sources and Path(text).suffix.lower() in VIDEO_SUFFIXES:
            _fail(f"{text}: there is no such file")
    host, bound = _bind(listen)
    token = "" if is_loopback(host) else secrets.token_urlsafe(24)
    with ExitStack() as stack:
        stack.enter_context(bound)
        playback: Playback | None = None
        if sources:
            key = f"view/{os.getpid()}"
            playback, what = stack.enter_context(playing(sources[0], key)), [key]
        url = _url(host, bound.getsockname()[1], token)
        typer.echo(f"open {url}")
        if open_page:
            webbrowser.open(url)
        try:
            run_server(what, bound, token, connect, config, playback)
        except (OSError, ValueError) as error:
            _fail(str(error))


def _bind(listen: str) -> tuple[str, socket.socket]:
    """The host, and a socket that listens."""
    host, _, port = listen.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal() or int(port) > 65535:
        _fail(f"--listen must be HOST:PORT, got {listen}; write for example 127.0.0.1:8090")
    try:
        family, *_, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)[0]
        return host, socket.create_server(address, family=family, backlog=BACKLOG)
    except OSError as error:
        _fail(f"--listen {listen}: {error.strerror or error}; name another address")


def _url(host: str, port: int, token: str) -> str:
    shown = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/" + (f"?token={token}" if token else "")


def _fail(message: str) -> NoReturn:
    typer.echo(f"error: {message}", err=True)
    raise typer.Exit(1)
