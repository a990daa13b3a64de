"""Several recordings of one machine to one diagnosis, and what becomes of it.

* `request` - what is asked, as processes hand it on
* `diagnose` - files to a diagnosis; `published` - its JSON, and the schema of that; `machine` - the machine file

Its pictures are in `bench.diagnoses.figures.forest`, its page in `bench.diagnoses.report.together`. Knows nothing of
terminals and HTTP; the physics is in `estimator.diagnosis.together`.
"""
