"""The pacer, on a clock that the test sets."""

import pytest

from emulator.clock import Pacer


class SetClock:
    """A clock that stands where it is put."""

    def __init__(self) -> None:
        self.t = 100.0  # s

    def __call__(self) -> float:
        return self.t


def test_as_many_periods_are_due_as_time_has_passed() -> None:
    clock = SetClock()
    pacer = Pacer(1e-3, most=1000, now=clock)
    assert pacer.due() == 0
    clock.t += 0.0105
    assert pacer.due() == 10
    assert pacer.due() == 0
    clock.t += 0.0006
    assert pacer.due() == 1
    assert pacer.overruns == 0


def test_no_period_is_lost_over_many_odd_steps() -> None:
    clock = SetClock()
    pacer = Pacer(1e-4, most=10**6, now=clock)
    told = 0
    for k in range(1000):
        clock.t = 100.0 + 0.00137 * (k + 1)
        told += pacer.due()
    assert told in (13699, 13700)


def test_it_catches_up_in_bounded_steps() -> None:
    clock = SetClock()
    pacer = Pacer(1e-3, most=40, patience=1.0, now=clock)
    clock.t += 0.1005
    assert [pacer.due() for _ in range(4)] == [40, 40, 20, 0]
    assert pacer.overruns == 0


def test_a_long_stop_is_given_up_and_counted() -> None:
    clock = SetClock()
    pacer = Pacer(1e-3, most=40, patience=0.5, now=clock)
    clock.t += 3600.0
    assert pacer.due() == 0
    assert pacer.overruns == 1
    clock.t += 0.0205
    assert pacer.due() == 20
    assert pacer.overruns == 1


def test_it_tells_how_long_to_wait() -> None:
    clock = SetClock()
    pacer = Pacer(1e-3, most=40, now=clock)
    assert pacer.wait_time(10) == pytest.approx(0.01)
    clock.t += 0.004
    assert pacer.wait_time(10) == pytest.approx(0.006)
    clock.t += 0.1
    assert pacer.wait_time(10) == 0.0


@pytest.mark.parametrize(("T_s", "most", "patience"), [(0.0, 1, 1.0), (1e-4, 0, 1.0), (1e-4, 1, 0.0)])
def test_a_pacer_without_a_period_is_refused(T_s: float, most: int, patience: float) -> None:
    with pytest.raises(ValueError, match="a pacer takes"):
        Pacer(T_s, most, patience)
