"""A file and what is known of its machine to a diagnosis, and what becomes of it.

* `diagnosis_request` - what is asked and what comes of it, as processes hand them on; `worker` - those processes
* `formats` - kinds of files; `diagnose` - a file to a diagnosis; `published` - its JSON, and the schema of that
* `figures` - its pictures as data; `report` - the page; `diagnosed_machine` - the machine file; `simulate` - the twin
* `together` - several recordings of one machine to one diagnosis
* `diagnosis_jobs` - the diagnoses of a service, kept in `bench.store.diagnoses`

Knows nothing of terminals and HTTP; the physics is in `estimator.diagnosis`.
"""
