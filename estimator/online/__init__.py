"""Estimates of R_s, L_d, L_q, psi_f while the motor runs, each with its standard error and status.

* `flux_balance` - the regression's rows, exact at any speed
* `estimate` - value, standard error, unit, status
* `sums`, `window_sums` - what a solution needs of a window, kept as rows come and go
* `fit` - sums to numbers; `excitation` - what a window can tell; `solve` - numbers to sentences
* `window_ls` - streaming sliding-window least squares; `auto_window` - a window chosen by the data; `track` - every row
* `skipping_rows` - rows that skip control periods, by an equation of their own
* `stream` - a stream cut into runs; `rls`, `ekf` over it - recursive least squares, the extended Kalman filter on
  `kalman`

Knows nothing of effects.
"""
