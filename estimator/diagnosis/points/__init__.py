"""Diagnosis of steady points: tables of steady states in place of every control period.

`table` holds them and leaves out what is no steady state, `model` and `no_load` say what the machine and every effect
make of them, `fit` and `search` choose effects by what they predict of points that were left out, `diagnose` says it.
"""
