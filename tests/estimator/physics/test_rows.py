"""What is derived from rows is never stale: each says all the fields that it reads."""

import inspect
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest

from estimator.machine import Machine
from estimator.physics.derived import Derived
from estimator.physics.rows import Rows
from tests.estimator.physics.equations import rows_without_noise, with_effect

FIELDS = {each.name for each in fields(Rows)}
DERIVED: dict[str, Derived[Any]] = {name: each for name, each in vars(Rows).items() if isinstance(each, Derived)}


class Noted:
    """Rows, or their machine, that note which fields are read. What is derived is worked out anew."""

    def __init__(self, of: Rows | Machine, read: set[str]) -> None:
        self._of, self._read = of, read

    def __getattr__(self, name: str) -> Any:
        found: Any = inspect.getattr_static(type(self._of), name)
        if isinstance(self._of, Machine):
            self._read.add("n_p" if name == "n_p" else "parameters")
            return getattr(self._of, name)
        if name == "machine":
            return Noted(self._of.machine, self._read)
        if name in FIELDS:
            self._read.add(name)
            return getattr(self._of, name)
        if name in DERIVED:
            return DERIVED[name].make(self)
        return found.__get__(self)  # a property's value, or a method

    def __len__(self) -> int:
        return len(self._of) if isinstance(self._of, Rows) else 0

    def once(self, make: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Worked out anew."""
        return make(self, *args, **kwargs)


@pytest.fixture(scope="module")
def rows() -> Rows:
    return rows_without_noise(with_effect("none", "servo_4nm"))


@pytest.mark.parametrize("name", DERIVED)
def test_what_is_derived_says_all_that_it_reads(name: str, rows: Rows) -> None:
    read = set[str]()
    DERIVED[name].make(Noted(rows, read))
    assert read
    assert read <= DERIVED[name].of


def test_what_is_derived_of_a_field_that_changed_is_worked_out_anew(rows: Rows) -> None:
    before = rows.i_mean
    assert rows.changed(i=rows.i).i_mean is not before
    assert rows.with_machine(replace(rows.machine, L_d=1.1 * rows.machine.L_d)).i_mean is not before
    assert rows.with_machine(replace(rows.machine, L_d=1.1 * rows.machine.L_d)).D is rows.D
