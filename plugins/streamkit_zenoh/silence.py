"""SilenceMonitor: notices that no record comes, and says why."""

from collections.abc import Callable

SILENCE_S = 5.0  # time without a record
MAX_KEYS = 8  # that are named


class SilenceMonitor:
    """Measures the time since the last record, and says once why none may come.

    Args:
        now_s: the clock.
        has_publisher: whether a publisher of the key is there.
        published_keys: the keys of all publishers; it takes a second, and is called once while none comes.
    """

    def __init__(
        self,
        now_s: Callable[[], float],
        has_publisher: Callable[[], bool],
        published_keys: Callable[[], list[str]],
    ) -> None:
        self._now_s = now_s
        self._has_publisher, self._published_keys = has_publisher, published_keys
        self.reset()

    def reset(self) -> None:
        """Starts again: a record has come."""
        self._began_s = self._now_s()
        self._noted_publisher: bool | None = None  # whether one was there at the last note

    @property
    def seconds(self) -> float:
        """Time since the last record, s."""
        return self._now_s() - self._began_s

    def reason(self) -> str:
        """How long and why no record came, to follow "no record"; "" if not for long, or if said already."""
        if self.seconds <= SILENCE_S or self._has_publisher() == self._noted_publisher:
            return ""
        self._noted_publisher = self._has_publisher()
        lasts = f" for {SILENCE_S:g} s"
        if self._noted_publisher:
            return f"{lasts}, though a publisher is there: has it lost its feed?"
        others = others_text(self._published_keys())
        return f"{lasts}: {others}" if others else f"{lasts}, no publisher is there"


def others_text(keys: list[str]) -> str:
    """A remark that other keys are published, with some of them; "" if there are none."""
    more = f" and {len(keys) - MAX_KEYS} more" if len(keys) > MAX_KEYS else ""
    return f"no publisher has this key; others have {', '.join(keys[:MAX_KEYS])}{more}" if keys else ""
