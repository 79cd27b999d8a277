"""Connection: base of zenohsink and zenohsrc, which opens their session."""

from dataclasses import replace

import zenoh

from streamkit import Element, ResourceError, SettingsOf, mask_secrets
from streamkit_zenoh.configuration import SessionFailure, SessionSettings
from streamkit_zenoh.endpoints import InvalidEndpoint
from streamkit_zenoh.session import open_session


class SessionElement(Element):
    """Declares the properties of a session; not an element itself."""

    session_settings = SettingsOf(SessionSettings)

    def open_zenoh(self, cut_off_s: float = 5.0) -> zenoh.Session:
        """Opens the session that the properties describe; see `SessionSettings` for `cut_off_s`.

        Raises:
            ResourceError: an endpoint is malformed, or the session cannot be opened.
        """
        settings = replace(self.session_settings, cut_off_s=cut_off_s)
        try:
            session = open_session(settings)
        except (InvalidEndpoint, SessionFailure) as error:
            raise ResourceError(str(error)) from None
        if settings.connect_endpoints and not list(session.info.transports()):
            shown = mask_secrets(", ".join(settings.connect_endpoints))
            self.post_warning(f"no session answers at {shown} yet; retrying in the background")
        return session
