"""The properties that zenohsink and zenohsrc have in common."""

from typing import Any

import zenoh

from streamkit import Element, Property, ResourceError
from streamkit_zenoh.endpoints import InvalidEndpoint, endpoints, redact
from streamkit_zenoh.session import Mode, Reach, SessionFailure, SessionSettings, open_session


class Connection(Element):
    """How an element takes part in zenoh; a base of elements, none itself."""

    connect: str | None = Property(
        None,
        doc="Endpoints to connect to, with commas: tcp/HOST:PORT of a router, a publisher or a receiver.",
    )
    listen: str | None = Property(None, doc="Endpoints to listen on, with commas: tcp/0.0.0.0:7447.")
    mode: Mode = Property(
        Mode.AUTO,
        doc="auto: a client where connect names another machine and nothing is listened on, else a peer.",
    )
    reach: Reach = Property(
        Reach.LOCAL, doc="Who is found without connect and listen: this machine, or the local network."
    )
    config: str | None = Property(
        None, doc="A zenoh configuration file (JSON5), for TLS, passwords and all else."
    )

    def open_zenoh(self, patience_s: float = 5.0) -> zenoh.Session:
        """Opens the session that the properties describe.

        Raises:
            ResourceError: an endpoint is none, or the session cannot be opened.
        """
        try:
            settings = SessionSettings(
                self.mode,
                endpoints(self.connect),
                endpoints(self.listen),
                self.reach,
                self.config,
                patience_s,
            )
            session = open_session(settings)
        except (InvalidEndpoint, SessionFailure) as error:
            raise ResourceError(str(error)) from None
        if settings.connect and not list(session.info.transports()):
            shown = redact(", ".join(settings.connect))
            self.post_warning(f"nobody answers at {shown} yet; trying on in the background")
        return session

    def properties_set(self) -> dict[str, Any]:
        """The properties set in the text; what endpoints carry in secrets is masked."""
        found = super().properties_set()
        return {
            name: redact(value) if name in ("connect", "listen") and isinstance(value, str) else value
            for name, value in found.items()
        }
