"""Noise: random numbers that are a function of (seed, source, counter) and nothing else.

There is no generator state to carry, so a run gives the same numbers, bit for bit, however it is cut into
calls. The bits are SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014,
doi 10.1145/2660193.2660195), entered at any place of its sequence; the seed and the source choose the start.
"""

import math

import numpy as np

from emulator.kernel import kernel

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


@kernel
def _mixed(z: np.uint64) -> np.uint64:
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@kernel
def uniform(seed: int, source: int, counter: int) -> float:
    """A number from 0 (included) to 1 (excluded)."""
    key = _mixed(_mixed(np.uint64(seed) + _GAMMA) + np.uint64(source) * _GAMMA)
    return float(_mixed(key + np.uint64(counter) * _GAMMA) >> _S11) * _UNIT


@kernel
def gauss(seed: int, source: int, counter: int) -> float:
    """A normal number of mean 0 and deviation 1 (Box and Muller 1958, doi 10.1214/aoms/1177706645)."""
    u_1 = uniform(seed, source, 2 * counter)
    u_2 = uniform(seed, source, 2 * counter + 1)
    return math.sqrt(-2.0 * math.log(1.0 - u_1)) * math.cos(2.0 * math.pi * u_2)
