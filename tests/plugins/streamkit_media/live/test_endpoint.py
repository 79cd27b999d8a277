import random

import pytest

from streamkit_media.live.endpoint import Backoff


def test_delays_double_up_to_the_cap() -> None:
    """Each delay is between half of its step and the step; the steps double and are capped."""
    backoff = Backoff(0.5, 10.0, random.Random(1))
    for longest in (0.5, 1, 2, 4, 8, 10, 10, 10):
        assert longest / 2 <= backoff.next_delay_s() <= longest
    assert backoff.tries == 8


def test_success_begins_anew() -> None:
    """After a reset the first delay comes again."""
    backoff = Backoff(0.5, 10.0, random.Random(1))
    for _ in range(5):
        backoff.next_delay_s()
    backoff.reset()
    assert backoff.tries == 0
    assert backoff.next_delay_s() <= 0.5


def test_two_clients_do_not_come_back_together() -> None:
    """Jitter: the same try of two clients is at different times."""
    first, second = (Backoff(1, 10, random.Random(seed)) for seed in (1, 2))
    assert first.next_delay_s() != second.next_delay_s()


@pytest.mark.parametrize("first_s", [0.0, 0.5])
def test_ten_thousand_tries_stay_bounded(first_s: float) -> None:
    """The delay never passes the cap and never overflows."""
    backoff = Backoff(first_s, 3.0, random.Random(0))
    assert all(0 <= backoff.next_delay_s() <= 3.0 for _ in range(10_000))
