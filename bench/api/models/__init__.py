"""Shapes of what the REST interface takes and says: pydantic models, of which the OpenAPI document is made.

* `drives` - drives, links, estimates, windows, health; `control` - a drive's state
* `captures`, `recordings`, `diagnoses`, `history`; `flashes` - parameter sets, plans, and what is flashed
* `metrics` - the service for Prometheus, which is text

SI units. Knows nothing of routes.
"""
