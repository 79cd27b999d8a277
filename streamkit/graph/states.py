"""States of a pipeline."""

from __future__ import annotations

import enum


class State(enum.StrEnum):
    """State of a pipeline."""

    NULL = "null"
    READY = "ready"
    PAUSED = "paused"
    PLAYING = "playing"


class StateChange(enum.StrEnum):
    """Result of a state change; ASYNC: sinks await their first frame; NO_PREROLL: the pipeline is live."""

    SUCCESS = "success"
    ASYNC = "async"
    NO_PREROLL = "no-preroll"
