"""Zenoh's quality of service as users write it: congestion control, priority and express."""

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


class InvalidQos(ValueError):
    """A text is not a quality of service."""


@dataclass(frozen=True)
class Qos:
    """Quality of service of one stream.

    Attributes:
        congestion: whether a full zenoh queue blocks the publisher or drops the message.
        priority: the zenoh queue.
        express: whether messages are sent at once instead of in batches.
    """

    congestion: zenoh.CongestionControl
    priority: zenoh.Priority
    express: bool = False


def parse_qos(text: str) -> Qos:
    """Parses `block,data-high,express`: words in any order, by default block and data.

    Raises:
        InvalidQos: a word is unknown, or there are two of one kind.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    congestion = [CONGESTION[word] for word in words if word in CONGESTION]
    priority = [PRIORITIES[word] for word in words if word in PRIORITIES]
    known = {*CONGESTION, *PRIORITIES, EXPRESS}
    if any(word not in known for word in words) or max(len(congestion), len(priority)) > 1:
        raise InvalidQos(
            f"a quality of service is one of {', '.join(CONGESTION)}, one of {', '.join(PRIORITIES)}, "
            f"and {EXPRESS} or not, with commas, got {text!r}; write for example drop,data-low"
        )
    return Qos(
        congestion[0] if congestion else zenoh.CongestionControl.BLOCK,
        priority[0] if priority else zenoh.Priority.DATA,
        EXPRESS in words,
    )
