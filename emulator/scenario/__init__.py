"""What is emulated: motor, drive, run and effects, built in or from a TOML file.

* `motors` - twelve motors as published
* `effects` - a section `[effects.<name>]` for each effect of `plant.physics`
* `scenarios` - the whole, from TOML; `text` - back to TOML

Knows nothing of how a scenario is simulated.
"""
