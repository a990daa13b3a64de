"""A lock that threads get in the order in which they came: one that takes it again and again starves nobody."""

import threading
from collections import deque
from typing import Final


class Turns:
    """Use as a context manager; not reentrant."""

    def __init__(self) -> None:
        self._guard: Final = threading.Lock()
        self._waiting: deque[threading.Lock] = deque()  # one that is released tells its thread that it is its turn
        self._taken = False

    def __enter__(self) -> None:
        with self._guard:
            if not self._taken:
                self._taken = True
                return
            turn = threading.Lock()
            turn.acquire()
            self._waiting.append(turn)
        turn.acquire()

    def __exit__(self, *_: object) -> None:
        with self._guard:
            if self._waiting:
                self._waiting.popleft().release()
            else:
                self._taken = False
