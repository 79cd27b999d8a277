"""For tests of elements: a harness that runs one element, and a manual clock."""

from streamkit.testing.clock import ManualClock
from streamkit.testing.harness import Harness

__all__ = ["Harness", "ManualClock"]
