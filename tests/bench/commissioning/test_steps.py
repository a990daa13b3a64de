"""The steps that a commissioning tells."""

from datetime import UTC, datetime, timedelta

from bench.actions.drive_jobs import Step
from bench.commissioning.commissionings import stepped

BEGUN = datetime(2026, 1, 31, tzinfo=UTC)


def test_how_far_a_step_has_come_is_told_with_it_and_what_is_said_again_is_no_step() -> None:
    steps: tuple[Step, ...] = ()
    said = (
        "stepping i_d by 2 A", "stepping i_d by 2 A", "stepping i_d by 2 A: uploading 0 of 5000 samples",
        "stepping i_d by 2 A: uploading 5000 of 5000 samples", "stepping i_d by 4 A",
    )  # fmt: skip
    for k, one in enumerate(said):
        steps = stepped(steps, Step(BEGUN + timedelta(seconds=k), one))
    assert [(step.at.second, step.said) for step in steps] == [(0, said[0]), (2, said[3]), (4, said[4])]
