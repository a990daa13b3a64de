"""Diagnosis of steady points: tables of steady states in place of every control period.

`table` holds them and leaves out what is no steady state, `model` and `no_load` say what the machine and every effect
make of them, `problem` states the equations, `fit` and `search` choose effects by what they predict of points that were
left out, `judge` weighs what was chosen, `diagnose` says it. `no_load_diagnosis` does where i_q is not known, and
`q_axis_diagnosis`, by `q_axis`, where u_d is not, of recordings in time as well. `witnessed` adds values that were
measured elsewhere.
"""
