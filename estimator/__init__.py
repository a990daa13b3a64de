"""Pure numerics: from samples to parameters with standard errors. No clocks, threads, files or sockets.

* `machine` - the machine's parameters; `samples` - SI columns without gaps; `flux_balance` - the regression's rows
* `window_ls` - streaming sliding-window least squares over the sums of `window_sums`; `auto_window` - a window
  chosen by the data; `track` - plain estimates at every row
* `rls`, `ekf` - recursive least squares and the extended Kalman filter over runs of `stream`; `kalman` - its rows
* `sums` - what a solution needs of a window; `fit` - from sums to numbers; `excitation` - what a window can tell;
  `solve` - from numbers to sentences; `estimate` - value, standard error, unit, status
* `twin` - the simulation: currents of a machine with effects from a recording's voltages, speed and angle
* `mismatch` - from a recording to a diagnosis: what was left out, where, how big; `physics` - the effects, a file each
* `kernel` - compilation, cached by the content of this room
"""
