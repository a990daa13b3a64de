"""How good the diagnosis is: concealed suites (`python -m emulator conceal`) diagnosed by who cannot see the answers.

`score` diagnoses a suite and compares with its answers; `oracle` says what could have been seen at best.

Seeds of suites: 1000 to 1999 for development, 2000 to 2999 for evaluation. What is reported comes from evaluation
seeds; nothing is ever tuned on them, and a recording of theirs that was looked into counts as development from then on.
"""
