"""How sure a set of effects is.

* `odds` - what the evidence of an effect is worth, measured
* `rivals` - odds against rivals, what cannot be told apart, what could have been seen
* `surrogate` - the recording as it would be without an effect: how often chance shows as much

Knows nothing of sentences.
"""
