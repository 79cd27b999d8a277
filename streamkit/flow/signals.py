"""Signals that unwind a streaming thread: not errors, but the reason why a push did not come back."""

from __future__ import annotations


class FlowStop(Exception):
    """Base: the frame was not taken and streaming on this path ends."""


class Flushing(FlowStop):
    """The pipeline is stopping."""


class EndOfStream(FlowStop):
    """Downstream wants no more frames."""


class NotLinked(FlowStop):
    """The pad has no peer."""
