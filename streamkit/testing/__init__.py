"""For authors' tests: a harness that runs one element, and a clock that is moved by hand."""

from streamkit.testing.clock import ManualClock
from streamkit.testing.harness import Harness

__all__ = ["Harness", "ManualClock"]
