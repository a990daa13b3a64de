"""Where a recording and a machine's data differ: whether, where, by which physics, and how sure that is.

`diagnose` takes a recording's samples and a nominal machine and returns a `verdict.Diagnosis`.
"""
