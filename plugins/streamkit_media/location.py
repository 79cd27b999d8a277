"""Values of `location=`: paths and URLs, shown without passwords."""

from __future__ import annotations

import re
from urllib.parse import quote, urlsplit

from streamkit import mask_secrets

URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")


def is_network(location: str) -> bool:
    """Whether a location is reached over the network: any URL but `file://`."""
    return URL.match(location) is not None and not location.startswith("file://")


def redact(text: str) -> str:
    """The text with secrets masked."""
    return mask_secrets(text)


def with_credentials(location: str, user: str, password: str) -> str:
    """The URL with a user name and password in it; one that has its own, or no user, stays as it is."""
    if not user or "@" in urlsplit(location).netloc:
        return location
    scheme, _, rest = location.partition("://")
    return f"{scheme}://{quote(user, safe='')}:{quote(password, safe='')}@{rest}"
