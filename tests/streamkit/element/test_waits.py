"""Waits of an element, as its author calls them."""

from streamkit.element.waits import Waits


def test_a_wait_while_paused_needs_no_argument_and_ends_at_a_stop():
    """True while the pipeline plays; False at once after a stop, also of a paused one."""
    waits = Waits()
    waits.timing.running.set()
    assert waits.wait_while_paused()
    waits.timing.running.clear()
    waits.halt()
    assert not waits.wait_while_paused()


def test_a_flush_since_then_ends_a_wait_while_paused():
    """Also one that is over before the thread looks."""
    waits = Waits()
    flushes = waits.flushes
    waits.flush(begins=True)
    waits.flush(begins=False)
    assert not waits.wait_while_paused(flushes)
