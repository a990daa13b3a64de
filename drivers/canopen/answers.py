"""Who answers SDO requests: of two nodes with one number each answers every request, as if the other were not there.

A frame that a bus repeats is answered twice as well, but now and then; requests of other clients, heard on the bus, are
counted with one's own. Pure; may be used from several threads.
"""

import itertools
import threading
from collections import deque
from typing import Final

from drivers.wire import canopen_od as od

SERIAL: Final = od.sdo_address(od.OD_IDENTITY, 4)
_KEPT: Final = 256  # requests that may wait for their answers at once, where a machine is busy
_WINDOW: Final = 16  # requests, the latest, by which it is told
_FEWEST: Final = 8  # requests by which it can be told
_ANSWERS: Final = 1.6  # a request, of two nodes 2


class Answers:
    """Requests and their answers, by addresses as SDO frames have them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._latest: deque[tuple[bytes, list[None]]] = deque(maxlen=_KEPT)  # address, an entry for each answer
        self._serials: list[int] = []  # different serial numbers that were answered

    def asked(self, address: bytes) -> None:
        """Somebody has asked for an object, or set it."""
        with self._lock:
            self._latest.append((address, []))

    def came(self, frame: bytes) -> None:
        """A frame of the server's, of 8 bytes."""
        address = frame[1:4]
        with self._lock:
            mine = [answers for asked, answers in self._latest if asked == address]
            if mine:  # the first without an answer, of requests that came together before the answers to them
                next((answers for answers in mine if not answers), mine[-1]).append(None)
            serial = int.from_bytes(frame[4:8], "little")
            if address == SERIAL and frame[0] == od.UPLOADED_4 and serial not in self._serials[:2]:
                self._serials.append(serial)

    @property
    def two(self) -> str:
        """How it is known that two nodes answer; empty where one does, as far as can be told."""
        with self._lock:
            if len(self._serials) > 1:
                return f"their serial numbers are {self._serials[0]} and {self._serials[1]}"
            latest = list(itertools.islice(reversed(self._latest), _WINDOW))
        requests, answers = len(latest), sum(len(answers) for _, answers in latest)
        if requests >= _FEWEST and answers >= _ANSWERS * requests:
            return f"to {requests} requests {answers} answers came"
        return ""
