"""What the service remembers: settings of windows, the history of estimates, captures and experiments that have ended.
SQLite, or a PostgreSQL of several benches.

* `tables` - what is kept; `database` - one that is open, brought up to date by `migrations`
* `memory` - all that is remembered: settings, and points of the history; `ended` - captures and experiments
* `found` - what files of recordings and diagnoses say of themselves, which are the truth
* `chronicle` - what happened to drives: events, writes, who controlled them, their parameters
* `keeper` - the thread that writes

Knows nothing of drives, links and HTTP.
"""
