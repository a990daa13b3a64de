"""Pure numerics: from samples to parameters, and from a mismatch to the physics that was left out.

Read in this order:

* `machine` - the machine's parameters; `samples` - SI columns without gaps; `arrays` - types; `kernel` - compiling
* `interval` - what ± means; `witness` - a value that something else has measured
* `online` - estimates while the motor runs, with standard errors; `export_c` - the same in C, for a drive's processor
* `mechanics` - a shaft's inertia, friction and load torque, from how it accelerates
* `physics` - what a machine, its inverter and its sensors do beyond the textbook, one effect a file
* `twin` - a machine with any set of effects: its voltages and currents
* `diagnosis` - a recording and a nominal machine to what was left out, where, how big, how sure

No clocks, threads, files or sockets. Shares no line with `emulator`.
"""
