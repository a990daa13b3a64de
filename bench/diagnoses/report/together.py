"""A diagnosis of several recordings as one HTML file that needs nothing else. It prints.

Words and their order are in `together.html.jinja`, looks in `page.css`. Knows nothing of files and of how the diagnosis
was found.
"""

from collections.abc import Sequence

from markupsafe import Markup

from bench.diagnoses.diagnosis_request import SETTLED
from bench.diagnoses.figures.figure import Figure
from bench.diagnoses.report.page import POLICY, length_of, style, template
from bench.machine_file import Nominal
from bench.recordings.recording import Summary
from estimator.diagnosis.together.said import Together
from estimator.machine import UNITS


def report(said: Together, recordings: Sequence[Summary], nominal: Nominal, figures: Sequence[Figure]) -> str:
    """The page; `figures` are those of the diagnosis."""
    return template("together.html.jinja").render(
        title=f"Diagnosis of {len(recordings)} recordings as one", said=said, nominal=nominal, policy=POLICY,
        style=Markup(style()), units=UNITS, settled=said.verdict in SETTLED,
        recordings=[(name, one, length_of(one)) for name, one in zip(said.recordings, recordings, strict=True)],
        pictures=figures,
        alone=list(zip(said.recordings, said.diagnoses, strict=True)),
    )  # fmt: skip
