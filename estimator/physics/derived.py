"""Quantities derived from rows: worked out once, at their first use, and never stale.

Each says of which fields it is made; rows of which others have changed have it still. Knows nothing of what rows hold.
"""

from collections.abc import Callable
from typing import Any, Final, Generic, Protocol, Self, TypeVar, overload

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Owner(Protocol):
    """What derived quantities are of."""

    def once(self, make: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        """What a function makes of this, worked out at its first call."""
        ...


class Derived(Generic[T_co]):
    """A property of rows. `turns`: the power of a turn of the frame that it takes with it; None where it does not."""

    def __init__(self, make: Callable[[Any], T_co], of: frozenset[str], turns: int | None) -> None:
        self.make: Final = make
        self.of: Final = of
        self.turns: Final = turns
        self.__doc__ = make.__doc__

    def __call__(self, owner: Any) -> T_co:
        """Worked out anew."""
        return self.make(owner)

    @overload
    def __get__(self, owner: None, kind: type) -> Self: ...
    @overload
    def __get__(self, owner: Owner, kind: type) -> T_co: ...
    def __get__(self, owner: Owner | None, kind: type) -> Self | T_co:
        return self if owner is None else owner.once(self)


def derived(*of: str, turns: int | None = None) -> Callable[[Callable[[Any], T]], Derived[T]]:
    """Make a function of rows a property that is worked out once. `of`: fields that it depends on."""
    return lambda make: Derived(make, frozenset(of), turns)
