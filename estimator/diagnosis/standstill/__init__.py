"""Recordings of a motor that stands: sine voltages of several frequencies, voltage pulses at several angles.

No speed, no angle, no nominal machine: what a servo or an inverter records before it turns the motor.
"""
