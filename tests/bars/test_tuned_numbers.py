"""What counts as a number that somebody chose."""

from tests.bars.tuned_numbers import counted


def test_numbers_of_constants_and_of_code_are_counted_apart_and_those_of_formulas_not() -> None:
    text = '''
"""A module, 17."""
_LEAST: Final = 0.3  # of it
RANGES = ((0.1, 1.0), (2.0, 5.0))
ROUNDS: Final = 2

def f(x: float) -> float:
    return 0.5 * x + 7.0 * x**2 - max(x, 1e-12)
'''
    assert counted(text) == (2, 3, 1)
