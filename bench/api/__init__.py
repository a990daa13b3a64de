"""REST and the page: HTTP over the service. asyncio lives here and nowhere else.

* `exchange` - requests, answers and refusals, whatever the route; `models` - shapes of what is said
* `signals`, `control`, `captures`, `experiments`, `flashes`, `recordings`, `diagnoses`, `history` - routes; `docs` -
  the page that describes them
* `app` - all routes; `guard` - who may call, how often, and what is written down; `server` - the port
"""
