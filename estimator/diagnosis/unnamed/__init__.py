"""What has no name in the library, described by its form.

* `branch` - a series R, L and C at the terminals; `ringing` - whether one shows
* `forms` - a line, a voltage that comes and goes, a resonance, a step
* `describe` - which of these it is, and where

Knows nothing of effects.
"""
