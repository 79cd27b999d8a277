"""The states of a pipeline, and what a change of state has come to."""

from __future__ import annotations

import enum


class State(enum.StrEnum):
    """What a pipeline is doing."""

    NULL = "null"
    READY = "ready"
    PAUSED = "paused"
    PLAYING = "playing"


class StateChange(enum.StrEnum):
    """What a change of state has come to.

    ASYNC: a paused pipeline still waits for its sinks' first frames; NO_PREROLL: it is live, and none come.
    """

    SUCCESS = "success"
    ASYNC = "async"
    NO_PREROLL = "no-preroll"
