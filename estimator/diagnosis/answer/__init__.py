"""What users are told of a fit.

* `finding` - one effect; `parameters` - the machine; `common_scale` - what no recording tells of it
* `quality`, `held_out` - how well the model follows; `pictures` - before and after
* `design` - which levels of speed and current would tell what is left in doubt
* `judged` - what of a fit can be told, once what is in doubt and helps nothing is taken away
* `statement` - that as a diagnosis; `convention_told` - beside a user's error
* `witnessed` - values measured elsewhere, and what the recording says of them
* `sentences` - the verdict in words; `beside` - a machine with effects beside another recording

Knows nothing of how the set of effects was found.
"""
