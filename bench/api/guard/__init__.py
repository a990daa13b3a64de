"""Before the application: who may call, how much at once, and what is written down of it.

* `connections`, `door` - how many there may be, and how long each may take
* `access`, `login`, `page_pass` - Host, Origin, token, and the cookie of a page
* `gate` - refuses who may not call; `load` - how much is worked on at once; `record` - what is written down of writes
* `preconditions` - which state a client has seen; `idempotency` - a job asked for again is begun once

Knows nothing of routes.
"""
