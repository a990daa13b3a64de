"""How good the diagnosis is: concealed suites (`python -m emulator conceal`) diagnosed by who cannot see the answers.

`score` diagnoses a suite and compares with its answers; `oracle` says what could have been seen at best.

Seeds of suites: 2000 to 2999 are for evaluation (`tests/proof/PROTOCOL.md`), all others for development; nothing is
ever tuned on an evaluation seed, and one that was looked into counts as development from then on.
"""

import os

os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # of the processes to come: one core each
