"""Pure numerics: from samples to parameters with standard errors. No clocks, threads, files or sockets.

* `machine` - the machine's parameters
* `samples` - SI columns without gaps; `flux_balance` - the regression's rows
* `window_ls` - streaming sliding-window least squares; `excitation` - what a window can tell
* `estimate` - value, standard error, unit, status
"""
