"""The set of effects that a recording calls for, and its best fit.

* `flux_step` - the moment of a step of the magnets' flux
* `fitting` - from the nominal machine to a model, found step by step
* `remainder` - whether what a fit leaves matters, and which effects only stand for it
* `exchange` - other sets for one that was found step by step
* `flux_map_fit`, `flux_map_stage` - a free flux map, and whether it takes the place of the library's saturations
* `stages` - the way through all of these

Knows nothing of verdicts.
"""
