"""Which row length a line would carry, by its losses or by what it carried."""

from drivers.rows import SPAN, Carried, Counts

ROW = 1e-3  # s


def counts(rows: int, lost: int) -> Counts:
    return Counts(rows=rows, rows_lost=lost)


def test_what_is_lost_asks_for_longer_rows_where_it_is_much_and_after_a_while() -> None:
    carried = Carried(ROW, counts(0, 0))
    span = round(SPAN / ROW)
    assert carried.periods(counts(100, 100), 10) == 10
    assert carried.periods(counts(span - 100, 100), 10) == 10
    assert carried.periods(counts(3 * span // 2 - 100, 100 + span // 2), 10) == 29  # half is carried, 0.7 asked for


def test_a_line_that_carries_all_in_between_loses_for_another_reason() -> None:
    carried = Carried(ROW, counts(0, 0), weighed=True)
    span = round(SPAN / ROW)
    carried.carries(1.3)
    carried.carries(0.2)
    assert carried.periods(counts(span // 2, span // 2), 10) == 10


def test_a_line_that_has_become_slow_is_slow_whatever_it_carried_before() -> None:
    carried = Carried(ROW, counts(0, 0), weighed=True)
    span = round(SPAN / ROW)
    carried.carries(1.3)
    assert carried.periods(counts(span // 2, span // 2), 10) == 10
    carried.carries(0.1)
    assert carried.periods(counts(span, span), 10) == 143
