"""User errors before physics: what no diagnosis should begin with.

* `odd_rows`, `bad_samples` - rows that no machine makes
* `correction`, `causes` - columns of another convention, and what each convention does to them
* `rough_fit` - the four parameters, whatever was done to the columns
* `phase_sensors` - a phase current that is turned or dead, by the sum of the three
* `data_sheet`, `drive_data` - nominal values and data of the drive that contradict the recording
* `input_check` - columns that hold nothing, are cut off, contradict each other; `convention` - which one was followed;
  `speed_factor` - what a speed was multiplied by, with no nominal machine; `speed_lag` - how late it is
* `voltage_frame` - voltages that were turned on by a speed, not by the angle's own movement
* `prepared` - rows and what is given, as every fit has them

Knows nothing of effects.
"""
