"""A shaft's moment of inertia, friction and load torque, from how it accelerates under the motor's torque.

* `stretches` - the equation of motion over stretches of the way: nothing is differentiated
* `suspects` - what a shaft may do beyond that equation
* `regression` - one length of stretches to numbers, with standard errors that residuals of any colour leave honest
* `doubts` - what is left beyond noise
* `mechanics` - the length that tells most, statuses and sentences

Knows nothing of voltages, drives and files.
"""
