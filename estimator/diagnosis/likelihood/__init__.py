"""A recording as one linear regression with white noise, and what it says of sets of effects.

* `given` - what is known of a drive beforehand
* `whitening` - voltages to flux errors; `noise` - how large their noise is; `averages` - means of them in V
* `columns` - the machine and every effect as columns; `thinning` - fewer rows of a long recording; `cleaning` - rows
  with less noise of their currents
* `evidence` - which set of effects the sums call for; `identifiability` - whether the currents moved enough
* `constant_parameters` - the same of rows that cover several periods, without effects

Knows nothing of how a set is searched for beyond one linearisation.
"""
