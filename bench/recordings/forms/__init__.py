"""Tables as other tools write them, brought to what a recording is: SI, even rows, the rotor frame.

* `units` - what a column's unit makes of its numbers
* `csv_form` - how a CSV is written, told by its beginning; `csv_rows` - its rows, and the lines that are none
* `times` - rounded times and counters that wrap
* `rotor_frame` - phase and alpha-beta quantities to dq, and the speed by the angle

Knows nothing of files' names, mappings and runs.
"""
