"""What the service remembers: settings of windows, and the history of estimates. SQLite, or a PostgreSQL of several
benches.

* `tables` - what is kept; `database` - one that is open, brought up to date by `migrations`
* `memory` - settings, and points of the history, written and read; `keeper` - the thread that writes

Knows nothing of drives, links and HTTP.
"""
