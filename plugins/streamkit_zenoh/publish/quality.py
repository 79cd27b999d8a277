"""Quality of service as users write it: congestion control, priority and express, of one stream."""

from dataclasses import dataclass

import zenoh

CONGESTION = {"block": zenoh.CongestionControl.BLOCK, "drop": zenoh.CongestionControl.DROP}
PRIORITIES = {
    "real-time": zenoh.Priority.REAL_TIME,
    "interactive-high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive-low": zenoh.Priority.INTERACTIVE_LOW,
    "data-high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data-low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}
EXPRESS = "express"


class InvalidQuality(ValueError):
    """A text is no quality of service."""


@dataclass(frozen=True)
class Quality:
    """How zenoh treats the messages of one stream.

    Attributes:
        congestion: block waits for room in zenoh's queue, drop throws the message away.
        priority: which queue.
        express: sent at once, and not together with what comes next.
    """

    congestion: zenoh.CongestionControl
    priority: zenoh.Priority
    express: bool = False


def quality(text: str) -> Quality:
    """Reads `block,data-high,express`: words in any order, each kind at most once.

    What is not said is block and data, and not express.

    Raises:
        InvalidQuality: a word is none of these, or there are two of one kind.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    congestion = [CONGESTION[word] for word in words if word in CONGESTION]
    priority = [PRIORITIES[word] for word in words if word in PRIORITIES]
    known = {*CONGESTION, *PRIORITIES, EXPRESS}
    if any(word not in known for word in words) or max(len(congestion), len(priority)) > 1:
        raise InvalidQuality(
            f"a quality of service is one of {', '.join(CONGESTION)}, one of {', '.join(PRIORITIES)}, "
            f"and {EXPRESS} or not, with commas, got {text!r}; write for example drop,data-low"
        )
    return Quality(
        congestion[0] if congestion else zenoh.CongestionControl.BLOCK,
        priority[0] if priority else zenoh.Priority.DATA,
        EXPRESS in words,
    )
