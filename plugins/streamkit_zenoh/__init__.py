"""Track records over zenoh: publishing and receiving.

    from streamkit_zenoh import TrackSubscriber

`session`, `configuration`, `keys` and `presence` open a zenoh session that finds
its partners on the same machine without a router; `wire` defines what is transmitted, `publish` publishes and
`receiver` receives it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from streamkit_zenoh.subscriber import TrackSubscriber as TrackSubscriber

__all__ = ["TrackSubscriber"]


def __getattr__(name: str) -> object:
    if name == "TrackSubscriber":
        from streamkit_zenoh.subscriber import TrackSubscriber

        return TrackSubscriber
    raise AttributeError(f"module 'streamkit_zenoh' has no attribute {name!r}")
