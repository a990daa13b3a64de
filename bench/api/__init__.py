"""REST and the page: HTTP over the service. asyncio lives here and nowhere else.

* `problems` - refusals as problem documents; `answers` - what routes have in common
* `models`, `capture_models`, `diagnosis_models` - shapes of what is said
* `signals`, `control`, `captures`, `experiments`, `diagnoses` - routes; `docs` - the page that describes them
* `app` - all routes; `guard` - who may call, how often, and what is written down; `server` - the port
"""
