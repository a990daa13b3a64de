"""A drive's parameters as a set: read, kept in files, planned, flashed, verified, and taken back.

* `parameter_set` - values by name, with what they are from, as a TOML file
* `tuning` - gains of the loops by rule; `tuned` - a set with them
* `from_diagnosis`, `from_estimates` - sets of what was found of a drive; `compensation` - what undoes which effect
* `plan` - what a set would change in a drive, and every reason why it may not
* `versions` - what was flashed before under the same name
* `journal` - what is under way, on disk before it is done
* `flash` - the transaction: image, write, read back, store, reset, read again; else all as before
* `told` - what was flashed, as plain values
* `link` - a drive by its URL, for who has no service
* `formats` - the set for other tools: DCF, C header, A2L

Knows nothing of services and HTTP.
"""
