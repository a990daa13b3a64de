"""A drive's stream to live estimates, and whether they may be trusted.

* `window`, `tuning` - settings of an estimation; `method` - the estimator that runs
* `q_axis` - estimates without a voltage of the d axis; `witnessed` - with values measured elsewhere
* `drive_clock` - a drive's clock beside ours; `acquisition` - one pump thread per drive
* `recent` - the rows of the last half minute, for whoever looks
* `watch` - since when constant parameters no longer explain the drive; `doubts` - what that does to a status
* `mechanics` - the shaft's inertia, friction and load torque
* `estimation` - one worker for all drives; `trust` - which estimates may be called ok

Knows nothing of disks and HTTP.
"""
