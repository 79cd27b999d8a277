"""Base of elements that connect to a server: address, credentials, TLS and retries."""

from __future__ import annotations

import enum
from typing import ClassVar
from urllib.parse import SplitResult, urlsplit

from streamkit import Element, Property, ResourceError, RestartDelay, mask_secrets
from streamkit_media.container import with_credentials
from streamkit_media.failures import AccessRefused, Silence, UnsupportedMedia
from streamkit_media.live.reachability import PLAIN_OF, RTSP_SCHEMES, port_of, trusted_authorities

JITTER = 0.5  # of the delays before retries


class Reconnect(enum.StrEnum):
    """When to connect again."""

    NEVER = "never"
    ON_ERROR = "on-error"
    ALWAYS = "always"


class Endpoint(Element):
    """Base of elements that connect to a server and connect again.

    Further class attributes: the `schemes` of the location, and its form for errors, `example`.
    """

    schemes: ClassVar[tuple[str, ...]] = RTSP_SCHEMES
    example: ClassVar[str] = "location=rtsp://host:port/path"

    location: str = Property(
        "", doc="URL, rtsp:// or rtsps://user:password@host:port/path; passwords are never shown."
    )
    user_id: str = Property("", doc="User name, where the URL has none.")
    user_pw: str = Property("", secret=True, doc="Password, where the URL has none; never shown.")
    tls_verify: bool = Property(
        True, doc="Over TLS, refuse a server whose certificate is not trusted or of another host."
    )
    tls_ca_file: str = Property(
        "",
        file="read",
        doc="Over TLS, file (PEM) of the authorities that are trusted; the system's where empty.",
    )
    timeout_s: float = Property(
        5.0, min=0.1, max=600.0, unit="s", doc="Silence, also while connecting, that ends a connection."
    )
    reconnect: Reconnect = Property(
        Reconnect.ON_ERROR,
        doc="Connect again never, when a connection fails, or always: also after a regular end, and where "
        "the first one fails.",
    )
    max_retries: int = Property(
        -1,
        min=-1,
        doc="Tries in a row before giving up. -1 is no limit once a connection has worked, and none before "
        "(a wrong address ends at once) unless reconnect=always.",
    )
    retry_delay_s: float = Property(
        0.5, min=0.0, max=600.0, unit="s", doc="Before the first retry; doubles with each, with jitter."
    )
    max_retry_delay_s: float = Property(
        10.0, min=0.0, max=3600.0, unit="s", doc="Longest wait before a retry."
    )

    def start(self) -> None:
        """Checks what can be checked without the server.

        Raises:
            ResourceError: the location is no URL of the schemes, or the authorities' file is not there.
        """
        longest_s = max(self.max_retry_delay_s, self.retry_delay_s)
        self._delay = RestartDelay(self.retry_delay_s, longest_s, JITTER)
        try:
            port_of(self.location)
        except ValueError as error:
            raise ResourceError(f"{error}, got {self._where!r}; write {self.example}") from None
        parts = urlsplit(self.location)
        self.check_address(parts)
        self._tls_options: dict[str, str] = {}
        if parts.scheme in PLAIN_OF and not self.tls_verify:
            self._tls_options = {"tls_verify": "0"}
        elif parts.scheme in PLAIN_OF:  # FFmpeg's default is to trust every server
            try:
                authorities = trusted_authorities(self.tls_ca_file)
            except OSError as error:
                raise ResourceError(f"tls-ca-file={self.tls_ca_file}: {error}") from None
            self._tls_options = {"tls_verify": "1", "ca_file": authorities}

    def check_address(self, parts: SplitResult) -> None:
        """Checks the parts of the location; raises `ResourceError` where they name no server."""
        if parts.scheme not in self.schemes or not parts.hostname:
            known = " or ".join(f"{scheme}://" for scheme in self.schemes)
            raise ResourceError(f"{self._where!r} must begin with {known} and a host; write {self.example}")

    @property
    def _where(self) -> str:
        """The location as it may be shown; one without its scheme may hold a password too."""
        if "://" not in self.location and "@" in self.location:
            return f"***@{self.location.rpartition('@')[2]}"
        return mask_secrets(self.location)

    @property
    def _url(self) -> str:
        """The location as FFmpeg gets it, which knows schemes in small letters only."""
        scheme, colon, rest = self.location.partition(":")
        return with_credentials(f"{scheme.lower()}{colon}{rest}", self.user_id, self.user_pw)

    def listens(self, failure: ResourceError | None) -> bool:
        """Whether to try again at once after a failure: the next try is itself a wait for the sender."""
        return False

    def _retry(self, failure: ResourceError | None, *, has_worked: bool) -> float:
        """Counts and reports the next try; the delay before it, s.

        Args:
            failure: why the connection ended; None where the stream has ended regularly.
            has_worked: whether a connection has worked before.

        Raises:
            ResourceError: the failure, where no other try helps or is wanted, or there were enough.
        """
        tries, limit = self._delay.tries, self.max_retries
        if isinstance(failure, Silence):
            self._post_state("stalled", reason=str(failure))
        if limit < 0 and not has_worked and self.reconnect is not Reconnect.ALWAYS:
            limit = 0
        is_last = (
            isinstance(failure, AccessRefused | UnsupportedMedia)
            or self.reconnect is Reconnect.NEVER
            or 0 <= limit <= tries
        )
        if failure is not None and is_last:
            self._post_state("gave-up", attempt=tries, reason=str(failure))
            raise ResourceError(f"{failure}; gave up after {tries} retries") if tries else failure
        reason = f"{self._where}: the stream has ended" if failure is None else str(failure)
        delay_s = self._delay.after()
        if self.listens(failure):
            delay_s = 0.0
        self._post_state("retrying", attempt=self._delay.tries, delay_s=round(delay_s, 3), reason=reason)
        self.post_warning(f"{reason}; retrying ({self._delay.tries}) in {delay_s:.1f} s")
        return delay_s

    def _post_state(self, state: str, **fields: object) -> None:
        self.post_message("connection", state=state, **fields)
