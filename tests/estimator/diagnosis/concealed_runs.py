"""Concealed recordings as their files have them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from emulator.conceal.files import write
from emulator.conceal.populations import KINDS
from emulator.conceal.recording import Choice, Concealed, drawn
from emulator.drive.virtual_drive import Column
from emulator.scenario.motors import MOTORS
from estimator.diagnosis.diagnose import TOLERANCE
from estimator.diagnosis.intake.prepared import prepared
from estimator.diagnosis.likelihood.given import Given
from estimator.machine import PARAMETERS, Machine
from estimator.physics.rows import Rows
from estimator.samples import Samples
from tests.score.diagnosed import loaded


def population(seed: int) -> Choice:
    """What the sealed recordings of a seed are drawn from."""
    return Choice(seed, KINDS, (0.0, 1.0), tuple(MOTORS), 6.0)


def recording_of(choice: Choice, number: int, folder: Path) -> tuple[Concealed, list[Samples], Machine]:
    """What it conceals, its runs, and the nominal machine. Its files are in the folder then."""
    return written(*drawn(choice, number), choice, folder)


def written(
    there: Concealed, columns: Mapping[str, Column], choice: Choice, folder: Path
) -> tuple[Concealed, list[Samples], Machine]:
    """What a drawn recording conceals, its runs, and the nominal machine. Its files are in the folder then."""
    write(there, columns, choice, "0001", folder, folder)
    return (there, *loaded(folder, "0001"))


def rows_of(choice: Choice, number: int, folder: Path) -> tuple[Rows, Given]:
    """Its rows as a diagnosis has them, and what is given of the drive."""
    return rows_as_diagnosed(*recording_of(choice, number, folder)[1:])


def rows_as_diagnosed(runs: Sequence[Samples], nominal: Machine) -> tuple[Rows, Given]:
    """Runs as rows, as a diagnosis has them, and what is given of the drive."""
    return prepared(runs, nominal, dict.fromkeys(PARAMETERS, TOLERANCE))
