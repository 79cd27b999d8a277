"""Access to the page: Host, Origin and token of each request are checked, response headers are set."""

from __future__ import annotations

import hmac
import ipaddress
import logging
import socket
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from streamkit_zenoh.configuration import is_loopback

LOG = logging.getLogger("streamkit.view")
COOKIE = "streamkit_view"  # and the port: browsers send a cookie to all ports of a host
POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "media-src blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
RESPONSE_HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
LOGGED_LIMIT = 100
_LOGGED: set[str] = set()


def log_once(reason: str) -> None:
    """Logs why something was refused; the same reason only once, and at most a hundred of them."""
    if reason not in _LOGGED and len(_LOGGED) < LOGGED_LIMIT:
        _LOGGED.add(reason)
        LOG.warning("refused: %s; further ones are not reported", reason)


@dataclass(frozen=True)
class Access:
    """Who may see the page.

    Attributes:
        token: what a browser must show to control a pipeline.
        is_local: whether only this machine can connect; else each request needs the token.
    """

    token: str
    is_local: bool

    def is_token(self, given: str) -> bool:
        """Compares a token in constant time."""
        return hmac.compare_digest(given.encode(), self.token.encode())


class AccessControl:
    """ASGI middleware that refuses requests of strangers.

    A page of another site must not read this one: it can send neither this `Host`, after DNS rebinding, nor
    this `Origin`. The token is in the address that is printed; the first response moves it into a cookie. A
    scope's `may_control` says whether its request has the token.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes a request on, or refuses it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                MutableHeaders(scope=message).update(RESPONSE_HEADERS)
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            # Answered with 403. After another response uvicorn logs an error each time.
            await send({"type": "websocket.close"})
        else:
            await refusal(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Response | None:
        request = HTTPConnection(scope)
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if not self._is_own_host(host):
            return _refuse(400, "a Host that is not this server's")
        if origin is None and scope["type"] == "websocket":
            return _refuse(403, "a websocket without Origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return _refuse(403, "another site's Origin")
        name = f"{COOKIE}_{(scope.get('server') or ('', 0))[1]}"
        scope["may_control"] = self._access.is_token(request.cookies.get(name, ""))
        given = request.query_params.get("token")
        if scope["type"] == "http" and given:
            if not self._access.is_token(given):
                return _refuse(403, "a wrong token")
            response = RedirectResponse("/", status_code=303)
            response.set_cookie(name, self._access.token, httponly=True, samesite="strict")
            return response
        if scope["may_control"] or self._access.is_local:
            return None
        return _refuse(401, "a request without token: open the address that `streamkit view` printed")

    def _is_own_host(self, host: str) -> bool:
        """A loopback name; beyond loopback also any address, and the name of this machine."""
        try:
            parts = urlsplit(f"//{host}")
            name, _ = parts.hostname or "", parts.port
        except ValueError:
            return False
        if is_loopback(name) or self._access.is_local:
            return is_loopback(name)
        try:
            return ipaddress.ip_address(name) is not None
        except ValueError:
            return name == socket.gethostname().lower()


def _refuse(code: int, reason: str) -> Response:
    log_once(reason)
    return PlainTextResponse(f"refused: {reason}\n", status_code=code)
