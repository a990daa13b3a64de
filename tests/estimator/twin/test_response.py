"""What a bridge loses in answer to a small voltage of the model: the currents that follow obey the circuit."""

import numpy as np

from estimator.arrays import Vector
from estimator.twin.response import Memory, Response, Slopes, answer

PERIODS = 40


def test_the_current_that_follows_obeys_the_circuit() -> None:
    random = np.random.default_rng(1)

    def some(size: float, n: int = PERIODS) -> Vector:
        return size * (random.normal(size=n) + 1j * random.normal(size=n))

    turn = np.exp(0.1j * np.arange(PERIODS + 1))
    slopes = Slopes(some(1.0) - 20.0, some(1.0) - 20.0j, some(1.0) + 20.0, some(1.0) + 20.0j)
    start, end = (some(2.0), some(2.0)), (some(2.0), some(2.0))
    response = Response(
        slopes, start, end, (some(1.0), some(1.0)), np.zeros(PERIODS + 1, bool), turn, np.full(PERIODS, np.exp(0.05j)),
        Memory(0.0, 0.0, 0.0), 0.0,
    )  # fmt: skip
    given = some(1.0)
    v, before = given.copy(), 0j
    for k in range(PERIODS):  # one by one: the state after each is the current there
        part, state = v[None, k : k + 1], np.array([[before, 0j]])
        answer(part, np.array([0]), response.within(slice(k, k + 1)), state)
        after = complex(state[0, 0])
        back, s, e = (turn[k] * np.exp(0.05j)).conj(), before * turn[k], after * turn[k + 1]
        lost = start[0][k] * s.real + start[1][k] * s.imag + end[0][k] * e.real + end[1][k] * e.imag
        circuit = sum(
            (slopes.start_d[k] * before.real, slopes.start_q[k] * before.imag),
            slopes.end_d[k] * after.real + slopes.end_q[k] * after.imag,
        )
        assert np.isclose(v[k], given[k] + lost * back)
        assert np.isclose(circuit, -v[k])
        before = after
