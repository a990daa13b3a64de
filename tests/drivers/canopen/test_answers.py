"""Whether two nodes answer as one, told by how many answers come."""

import pytest

from drivers.canopen.answers import Answers
from drivers.wire import canopen_od as od

STATUS, NAME = od.sdo_address(0x6041, 0), od.sdo_address(0x1008, 0)


def answer(address: bytes) -> bytes:
    return b"\x4b" + address + bytes(4)


@pytest.mark.parametrize("together", [1, 5, 40])
@pytest.mark.parametrize("nodes", [1, 2])
def test_answers_are_counted_by_their_requests_however_many_of_these_come_before(together: int, nodes: int) -> None:
    answers = Answers()
    for _ in range(3):
        asked = [address for _ in range(together) for address in (STATUS, STATUS, NAME)]
        for address in asked:
            answers.asked(address)
        for address in asked:
            for _ in range(nodes):
                answers.came(answer(address))
                assert nodes == 2 or not answers.two
    assert bool(answers.two) == (nodes == 2)


def test_requests_without_an_answer_do_not_hide_a_second_node() -> None:
    answers = Answers()
    for count in range(60):
        answers.asked(STATUS)
        if count % 10:
            answers.came(answer(STATUS))
            answers.came(answer(STATUS))
    assert answers.two
