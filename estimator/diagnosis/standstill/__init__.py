"""Recordings of a motor that stands: sine voltages of several frequencies, voltage pulses at several angles.

No speed, no angle, no nominal machine: what a servo or an inverter records before it turns the motor. `sweep` says what
sines tell, by the model of `sweep_fit` on the harmonics of `tones`; `pulses` says what pulses tell, by the model of
`pulse_fit`; `sensors` says what a sum of three currents tells of who measures them.
"""
