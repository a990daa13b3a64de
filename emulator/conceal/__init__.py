"""Concealed recordings: random motor, run and effects, so that who reads a recording has to find out.

    python -m emulator conceal --count 100 --seed 7 --out DIR --answers DIR2

A recording is decided by two kinds of chance that know nothing of each other: one draws motor, drive, run and noise
(`runs`), the other the class and its sizes (`populations`, those of a drive's `measuring_chain`, of `angle_sensors` and
of `outside_warmth` among them; each is a `population`). So the same number of the same seed is the same run in every
class, and whatever is told by the run tells nothing of the class. What no reader of voltages, currents and angle
could see, because it does not bend their relation - friction, a compliant shaft, a dc link that sags, lost rows -, is
no class but belongs to the run. `recording` runs what both have drawn by `chance`, `suite` makes many, `files` are
what a user gets and, elsewhere, the answers; `command` is the command line's.
"""
