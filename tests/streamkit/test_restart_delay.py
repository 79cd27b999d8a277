import pytest

from streamkit import RestartDelay


def test_delays_double_up_to_the_limit() -> None:
    """Each delay is between half of its step and the step; the steps double and are capped."""
    delay = RestartDelay(0.5, 10.0, jitter=0.5)
    for longest in (0.5, 1, 2, 4, 8, 10, 10, 10):
        assert longest / 2 <= delay.after() <= longest
    assert delay.tries == 8


def test_success_begins_anew() -> None:
    """After a reset, or a try that lasted a minute, the first delay comes again."""
    delay = RestartDelay(0.5, 10.0)
    for _ in range(5):
        delay.after(59.0)
    delay.reset()
    assert delay.tries == 0
    assert [delay.after(), delay.after(), delay.after(60.0)] == [0.5, 1.0, 0.5]


def test_two_clients_do_not_come_back_together() -> None:
    """Jitter: the same try of two clients is at different times."""
    assert RestartDelay(1, 10, 0.5).after() != RestartDelay(1, 10, 0.5).after()


@pytest.mark.parametrize("first_s", [0.0, 0.5])
def test_ten_thousand_tries_stay_bounded(first_s: float) -> None:
    """The delay never passes the limit and never overflows."""
    delay = RestartDelay(first_s, 3.0, jitter=0.5)
    assert all(0 <= delay.after() <= 3.0 for _ in range(10_000))
