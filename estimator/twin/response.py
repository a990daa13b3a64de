"""How the voltage that a bridge loses answers a small change of a model, by the currents that follow it.

A parameter of the model changes the voltage that currents imply by so much, v. The currents that follow the recorded
voltage move, and the lost voltage with them: it changes much within a little of a current near zero. With the bridge's
slopes by the currents at a period's start and end, that is a line from period to period:

    (end + lost by end) delta[k+1] = -v[k] - (start + lost by start) delta[k]

Knows no parameter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.arrays import Bools, Vector
from estimator.kernel import lean_kernel


class Memory(NamedTuple):
    """A resistance (ohm) to what a current has changed lately, and the share that is forgotten in a period."""

    R: float
    share: float
    late: float  # and of what the current changes within the period


class Slopes(NamedTuple):
    """How each period's voltage changes with the current (ohm) at its start and its end, along d and q."""

    start_d: Vector
    start_q: Vector
    end_d: Vector
    end_q: Vector


class Response(NamedTuple):
    """How the lost voltage of each period answers a small voltage of the model."""

    slopes: Slopes
    by_start: tuple[Vector, Vector]  # ohm: lost voltage by the real and imaginary current at the start; stationary
    by_end: tuple[Vector, Vector]  # the same at the end
    direct: tuple[Vector, Vector]  # lost voltage a second of dead time, a volt of drop, at the same currents; V, rotor
    starts: Bools  # samples
    rotor: Vector  # samples
    half: Vector
    memory: Memory
    forgotten: float

    def within(self, cut: slice) -> "Response":
        """Of some periods."""
        ends = slice(cut.start, cut.stop + 1)

        def both(pair: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
            return pair[0][cut], pair[1][cut]

        return Response(
            Slopes(*(slope[cut] for slope in self.slopes)), both(self.by_start), both(self.by_end), both(self.direct),
            self.starts[ends], self.rotor[ends], self.half[cut], self.memory, self.forgotten,
        )  # fmt: skip


@lean_kernel
def answer(v: NDArray[np.complex128], which: NDArray[np.intp], of: Response, state: NDArray[np.complex128]) -> None:
    """Add to some voltages of the model (columns x periods, V) what the bridge loses in answer; `state` (columns x 2)
    goes on from stretch to stretch.
    """
    slopes, (start_re, start_im), (end_re, end_im), _, starts, rotor, half, memory, forgotten = of
    R, share, late = memory
    for c in which:
        delta, i_x = state[c, 0], state[c, 1]
        for k in range(v.shape[1]):
            before, after = half[k].conjugate(), half[k]
            back = (rotor[k] * after).conjugate()
            s, e = delta * rotor[k], rotor[k + 1]
            lost = start_re[k] * s.real + start_im[k] * s.imag
            there = 0j
            if not starts[k + 1]:
                left = -v[c, k] - slopes.start_d[k] * delta.real - slopes.start_q[k] * delta.imag - lost * back
                left -= R * ((share - late) * before * delta - share * back * i_x)
                d_lost, q_lost = end_re[k] * e.real + end_im[k] * e.imag, end_im[k] * e.real - end_re[k] * e.imag
                d = slopes.end_d[k] + R * late * after + d_lost * back
                q = slopes.end_q[k] + 1j * R * late * after + q_lost * back
                x = solved_real(d, q, left)
                v[c, k] += (lost + d_lost * x.real + q_lost * x.imag) * back
                there = x * (1.0 - forgotten)
            i_x += share * (s - i_x) + late * (there * e - s)
            delta = there
        state[c, 0], state[c, 1] = delta, i_x


@lean_kernel
def solved_real(d: complex, q: complex, v: complex) -> complex:
    """x of d Re x + q Im x = v."""
    det = d.real * q.imag - d.imag * q.real
    return complex((v.real * q.imag - v.imag * q.real) / det, (d.real * v.imag - d.imag * v.real) / det)
