"""Request and answer, whatever the route.

* `kinds` - what a request does: reads, stops a motor, begins a job, brings a file
* `problems` - refusals as problem documents; `answers` - bodies, queries and pages, and what is said of every route
* `upload` - a file that is brought, to the disk as it comes

Knows nothing of routes, and of who may call.
"""
